//! Serves the page and its data over HTTP and WebSocket on one port: a blocking thread for each connection, with limits
//! for all.
//!
//! A page may ask for files and for the time, and may play the keys that are on offer. Nothing else can be controlled.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use thiserror::Error;

mod access;
mod answer;
mod assets;
mod connection;
mod hub;
mod keys;
mod pace;
mod player;
mod request;
mod strangers;
mod viewer;

pub use access::Key;
pub use hub::{Cursor, Hub, Keep, Next};
pub use keys::{PageKey, PagePoints};

use strangers::Strangers;

/// Limits of connections; the defaults suit people, tests use shorter times.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest number of live viewers.
    pub viewers: usize,
    /// Largest number of connections that have given the key, including viewers.
    pub connections: usize,
    /// Largest number of connections that have not given it yet; a new one takes the place of an older one.
    pub strangers: usize,
    /// Time within which a request must be complete \[s\].
    pub head: Duration,
    /// Time without progress after which a connection is dropped \[s\].
    pub stall: Duration,
    /// Lowest rate at which a reader must take data [bytes/s], after the first `stall`.
    pub floor: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            viewers: 16,
            connections: 64,
            strangers: 32,
            head: Duration::from_secs(5),
            stall: Duration::from_secs(5),
            floor: 64 << 10,
        }
    }
}

/// What is served, and where.
#[derive(Clone, Debug)]
pub struct Options {
    /// Address and port; port 0 is any free one.
    pub address: SocketAddr,
    /// Secret that is part of every address: other users of this machine can reach the port too.
    pub key: Key,
    /// The `.motion` file that pages play.
    pub file: Option<PathBuf>,
    /// The WAV or FLAC file that is played with it.
    pub sound: Option<PathBuf>,
    /// The keys that pages may play.
    pub keys: Vec<Arc<dyn PageKey>>,
    /// See [`Limits`].
    pub limits: Limits,
}

impl Options {
    /// Serves a file to pages on this machine only.
    pub fn local(file: PathBuf, key: Key) -> Self {
        Self {
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
            key,
            file: Some(file),
            sound: None,
            keys: Vec::new(),
            limits: Limits::default(),
        }
    }
}

/// Why the server cannot start.
#[derive(Debug, Error)]
pub enum ServeError {
    /// The port is taken, or is not this machine's.
    #[error("{0}: {1}")]
    Bind(SocketAddr, io::Error),
}

/// Counts of connections and requests.
#[derive(Debug, Default)]
pub struct Tally {
    /// Requests that got what they asked for.
    pub served: AtomicU64,
    /// Requests that got an error, or no answer.
    pub refused: AtomicU64,
    /// Connections dropped because the reader was too slow, or the page sent a message that the protocol does not have.
    pub dropped: AtomicU64,
    /// Number of connected live viewers.
    pub viewers: AtomicUsize,
    /// Connections that have given the key.
    connections: AtomicUsize,
}

/// Data shared by all connections.
struct Shared {
    options: Options,
    address: SocketAddr,
    hub: Hub,
    tally: Tally,
    strangers: Arc<Strangers>,
    over: AtomicBool,
    begin: Instant,
}

/// Serves until it is dropped.
pub struct Server {
    shared: Arc<Shared>,
    listener: Option<thread::JoinHandle<()>>,
}

impl Server {
    /// Starts to listen.
    ///
    /// # Errors
    ///
    /// [`ServeError`] if the port cannot be opened.
    pub fn start(options: Options) -> Result<Self, ServeError> {
        let bind_error = |error| ServeError::Bind(options.address, error);
        let listener = TcpListener::bind(options.address).map_err(bind_error)?;
        let address = listener.local_addr().map_err(bind_error)?;
        let shared = Arc::new(Shared {
            options,
            address,
            hub: Hub::default(),
            tally: Tally::default(),
            strangers: Arc::default(),
            over: AtomicBool::new(false),
            begin: Instant::now(),
        });
        let listener_shared = shared.clone();
        let listener = thread::Builder::new()
            .name("view".into())
            .spawn(move || listen(&listener, &listener_shared))
            .map_err(|error| ServeError::Bind(address, error))?;
        Ok(Self {
            shared,
            listener: Some(listener),
        })
    }

    /// The address at which it listens.
    pub fn address(&self) -> SocketAddr {
        self.shared.address
    }

    /// The URL to open in a browser, with the key.
    pub fn url(&self) -> String {
        format!("http://{}/{}/", self.shared.local_address(), self.shared.options.key)
    }

    /// The messages for all viewers.
    pub fn hub(&self) -> &Hub {
        &self.shared.hub
    }

    /// Counts so far.
    pub fn tally(&self) -> &Tally {
        &self.shared.tally
    }

    /// The server's clock, with which pages compare theirs \[s\].
    pub fn now(&self) -> f64 {
        self.shared.now()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Release);
        self.shared.hub.close();
        // The listener waits in `accept`: a connection from here wakes it.
        let address = self.shared.local_address();
        let is_woken = TcpStream::connect_timeout(&address, Duration::from_secs(1)).is_ok();
        if let Some(listener) = self.listener.take()
            && is_woken
        {
            let _ = listener.join();
        }
    }
}

impl Shared {
    fn now(&self) -> f64 {
        self.begin.elapsed().as_secs_f64()
    }

    /// The address by which this machine reaches the server: that at which it listens, or loopback if it listens at
    /// all.
    fn local_address(&self) -> SocketAddr {
        let server_ip = match self.address.ip() {
            server_ip if !server_ip.is_unspecified() => server_ip,
            _ => IpAddr::V4(Ipv4Addr::LOCALHOST),
        };
        SocketAddr::new(server_ip, self.address.port())
    }

    fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }
}

/// A place among the connections or viewers; dropping it frees the place.
struct Slot<'a>(&'a AtomicUsize);

impl<'a> Slot<'a> {
    fn take(slots: &'a AtomicUsize, limit: usize) -> Option<Self> {
        slots
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, |n| (n < limit).then_some(n + 1))
            .ok()
            .map(|_| Self(slots))
    }
}

impl Drop for Slot<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Connection threads need little stack: files are sent in pieces, and messages are shared.
const STACK: usize = 512 << 10;

fn listen(listener: &TcpListener, shared: &Arc<Shared>) {
    loop {
        let accepted = listener.accept();
        if shared.is_over() {
            return;
        }
        let Ok((client_stream, peer_address)) = accepted else {
            // No file descriptors are left; other connections may free some.
            thread::sleep(Duration::from_millis(10));
            continue;
        };
        let client_stream = Arc::new(client_stream);
        let stranger_limit = shared.options.limits.strangers;
        let stranger_place = shared
            .strangers
            .admit(&client_stream, peer_address.ip(), stranger_limit);
        let shared = shared.clone();
        let refusal_shared = shared.clone();
        let spawn_result = thread::Builder::new()
            .name("view client".into())
            .stack_size(STACK)
            .spawn(move || connection::serve(&client_stream, stranger_place, &shared));
        if spawn_result.is_err() {
            refusal_shared.tally.refused.fetch_add(1, Ordering::Relaxed);
        }
    }
}
