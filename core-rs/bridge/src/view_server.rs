//! The server of the page.

use std::collections::BTreeMap;
use std::net::ToSocketAddrs;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ergon_view::serve::{Key, Limits, Options, Server};
use pyo3::prelude::*;

use crate::error::said;

/// Serves a file to pages, until it is closed.
#[pyclass(module = "ergon._core", frozen)]
pub(crate) struct ViewServer(Mutex<Option<Server>>);

impl ViewServer {
    fn server(&self) -> MutexGuard<'_, Option<Server>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with<T>(&self, look: impl FnOnce(&Server) -> T) -> PyResult<T> {
        let server = self.server();
        server
            .as_ref()
            .map(look)
            .ok_or_else(|| said("the server is closed"))
    }
}

#[pymethods]
impl ViewServer {
    #[new]
    #[pyo3(signature = (path, *, sound=None, at="127.0.0.1:0", key=None))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        sound: Option<PathBuf>,
        at: &str,
        key: Option<&str>,
    ) -> PyResult<Self> {
        let no_place = || said(format!("{at} is no place of this machine: write HOST:PORT"));
        let place = py.detach(|| at.to_socket_addrs());
        let at = place.ok().and_then(|mut all| all.next());
        let key = key
            .map(|digits| Key::new(digits).ok_or_else(|| said("a key has 32 hexadecimal digits")));
        let options = Options {
            at: at.ok_or_else(no_place)?,
            key: key.transpose()?,
            file: Some(path),
            sound,
            limits: Limits::default(),
        };
        let server = Server::start(options).map_err(said)?;
        Ok(Self(Mutex::new(Some(server))))
    }

    #[getter]
    fn url(&self) -> PyResult<String> {
        self.with(Server::url)
    }

    #[getter]
    fn tally(&self) -> PyResult<BTreeMap<&'static str, u64>> {
        self.with(|server| {
            let tally = server.tally();
            BTreeMap::from([
                ("served", tally.served.load(Ordering::Relaxed)),
                ("refused", tally.refused.load(Ordering::Relaxed)),
                ("dropped", tally.dropped.load(Ordering::Relaxed)),
                ("viewers", tally.viewers.load(Ordering::Relaxed) as u64),
            ])
        })
    }

    fn close(&self, py: Python<'_>) {
        let server = self.server().take();
        py.detach(|| drop(server));
    }
}
