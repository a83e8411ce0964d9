//! HTTP and WebSocket server of the page.

use std::collections::BTreeMap;
use std::net::ToSocketAddrs;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ergon_live::perform::WindowServer;
use ergon_view::serve::{AccessKey, ConnectionLimits, PageKey, Server, ServerOptions};
use pyo3::prelude::*;

use crate::error::plain_error;
use crate::lead::Lead;
use crate::motion::Window;
use crate::perform::Performance;

/// Serves the page, with a `.motion` file or what is played, until it is closed.
#[pyclass(module = "ergon._core", frozen)]
pub(crate) struct ViewServer(Mutex<Option<OpenServer>>);

/// Fields are dropped in this order: `window`, which uses the server, before the server.
struct OpenServer {
    /// Present from the first performance on.
    window_server: Option<WindowServer>,
    server: Arc<Server>,
}

impl ViewServer {
    fn lock_server(&self) -> MutexGuard<'_, Option<OpenServer>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with<T>(&self, work: impl FnOnce(&mut OpenServer) -> T) -> PyResult<T> {
        let mut server_lock = self.lock_server();
        server_lock
            .as_mut()
            .map(work)
            .ok_or_else(|| plain_error("the server is closed"))
    }
}

#[pymethods]
impl ViewServer {
    #[new]
    #[pyo3(signature = (path=None, *, sound=None, address="127.0.0.1:0", key, leads=Vec::new()))]
    fn new(
        py: Python<'_>,
        path: Option<PathBuf>,
        sound: Option<PathBuf>,
        address: &str,
        key: &str,
        leads: Vec<PyRef<'_, Lead>>,
    ) -> PyResult<Self> {
        let address_error = || plain_error(format!("{address} is not an address of this machine; write HOST:PORT"));
        let address_lookup = py.detach(|| address.to_socket_addrs());
        let socket_address = address_lookup.ok().and_then(|mut addresses| addresses.next());
        let key = AccessKey::new(key).ok_or_else(|| plain_error("a key has 32 hexadecimal digits"))?;
        let options = ServerOptions {
            address: socket_address.ok_or_else(address_error)?,
            access_key: key,
            motion_file: path,
            sound_file: sound,
            page_keys: leads.iter().map(|lead| lead.0.clone() as Arc<dyn PageKey>).collect(),
            limits: ConnectionLimits::default(),
        };
        let server = Server::start(options).map_err(plain_error)?;
        let server = Arc::new(server);
        let showing = None;
        Ok(Self(Mutex::new(Some(OpenServer {
            window_server: showing,
            server,
        }))))
    }

    #[getter]
    fn url(&self) -> PyResult<String> {
        self.with(|open| open.server.url())
    }

    /// Show a performance through `window`, as soon as the simulation plays for which the window was made.
    fn show(&self, window: &Window, performance: &Performance) -> PyResult<()> {
        let (display_window, window_reader) = window.take_ends()?;
        let output_times = performance.with(|performance_now| performance_now.output_times())?;
        self.with(|open| {
            let window_server = match open.window_server.take() {
                Some(showing) => showing,
                None => WindowServer::start(open.server.clone()).map_err(plain_error)?,
            };
            window_server.show(window_reader, output_times);
            open.window_server = Some(window_server);
            Ok::<_, PyErr>(())
        })??;
        // Opened last, when the server is ready to take pictures from it.
        let is_accepted = performance.with(|performance_now| performance_now.open_window(display_window))?;
        is_accepted
            .then_some(())
            .ok_or_else(|| plain_error("too many requests at once; try again"))
    }

    #[getter]
    fn tally(&self) -> PyResult<BTreeMap<&'static str, u64>> {
        self.with(|open| {
            let server_tally = open.server.counts();
            let skipped_count = open.window_server.as_ref().map_or(0, WindowServer::skipped_count);
            BTreeMap::from([
                ("skipped", skipped_count),
                ("served", server_tally.served.load(Ordering::Relaxed)),
                ("refused", server_tally.refused.load(Ordering::Relaxed)),
                ("dropped", server_tally.dropped.load(Ordering::Relaxed)),
                ("viewers", server_tally.viewers.load(Ordering::Relaxed) as u64),
            ])
        })
    }

    fn close(&self, py: Python<'_>) {
        let open_server = self.lock_server().take();
        py.detach(|| drop(open_server));
    }
}
