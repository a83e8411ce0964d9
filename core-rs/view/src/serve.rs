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
mod pending_connections;
mod player;
mod request;
mod viewer;

pub use access::AccessKey;
pub use hub::{MessageHub, NextMessage, Retention, ViewerCursor};
pub use keys::{KeyPoints, PageKey};

use pending_connections::PendingConnections;

/// Limits of connections; the defaults suit people, tests use shorter times.
#[derive(Clone, Copy, Debug)]
pub struct ConnectionLimits {
    /// Largest number of live viewers.
    pub viewers: usize,
    /// Largest number of connections that have given the key, including viewers.
    pub connections: usize,
    /// Largest number of connections that have not given it yet; a new one takes the place of an older one.
    pub pending_connections: usize,
    /// Time within which a request must be complete \[s\].
    pub head_timeout: Duration,
    /// Time without progress after which a connection is dropped \[s\].
    pub stall_timeout: Duration,
    /// Lowest rate at which a reader must take data [bytes/s], after the first `stall_timeout`.
    pub byte_rate_min: u64,
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self {
            viewers: 16,
            connections: 64,
            pending_connections: 32,
            head_timeout: Duration::from_secs(5),
            stall_timeout: Duration::from_secs(5),
            byte_rate_min: 64 << 10,
        }
    }
}

/// What is served, and where.
#[derive(Clone, Debug)]
pub struct ServerOptions {
    /// Address and port; port 0 is any free one.
    pub address: SocketAddr,
    /// Secret that is part of every address: other users of this machine can reach the port too.
    pub access_key: AccessKey,
    /// The `.motion` file that pages play.
    pub motion_file: Option<PathBuf>,
    /// The WAV or FLAC file that is played with it.
    pub sound_file: Option<PathBuf>,
    /// The keys that pages may play.
    pub page_keys: Vec<Arc<dyn PageKey>>,
    /// See [`ConnectionLimits`].
    pub limits: ConnectionLimits,
}

impl ServerOptions {
    /// Serves a file to pages on this machine only.
    pub fn local(file: PathBuf, key: AccessKey) -> Self {
        Self {
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
            access_key: key,
            motion_file: Some(file),
            sound_file: None,
            page_keys: Vec::new(),
            limits: ConnectionLimits::default(),
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
pub struct ConnectionCounts {
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
struct ServerState {
    options: ServerOptions,
    address: SocketAddr,
    hub: MessageHub,
    counts: ConnectionCounts,
    pending_connections: Arc<PendingConnections>,
    is_stopping: AtomicBool,
    start_instant: Instant,
}

/// Serves until it is dropped.
pub struct Server {
    state: Arc<ServerState>,
    listener_thread: Option<thread::JoinHandle<()>>,
}

impl Server {
    /// Starts to listen.
    ///
    /// # Errors
    ///
    /// [`ServeError`] if the port cannot be opened.
    pub fn start(options: ServerOptions) -> Result<Self, ServeError> {
        let bind_error = |error| ServeError::Bind(options.address, error);
        let listener = TcpListener::bind(options.address).map_err(bind_error)?;
        let address = listener.local_addr().map_err(bind_error)?;
        let server_state = Arc::new(ServerState {
            options,
            address,
            hub: MessageHub::default(),
            counts: ConnectionCounts::default(),
            pending_connections: Arc::default(),
            is_stopping: AtomicBool::new(false),
            start_instant: Instant::now(),
        });
        let listener_state = server_state.clone();
        let listener = thread::Builder::new()
            .name("view".into())
            .spawn(move || listen(&listener, &listener_state))
            .map_err(|error| ServeError::Bind(address, error))?;
        Ok(Self {
            state: server_state,
            listener_thread: Some(listener),
        })
    }

    /// The address at which it listens.
    pub fn address(&self) -> SocketAddr {
        self.state.address
    }

    /// The URL to open in a browser, with the key.
    pub fn url(&self) -> String {
        format!(
            "http://{}/{}/",
            self.state.local_address(),
            self.state.options.access_key
        )
    }

    /// The messages for all viewers.
    pub fn hub(&self) -> &MessageHub {
        &self.state.hub
    }

    /// Counts so far.
    pub fn counts(&self) -> &ConnectionCounts {
        &self.state.counts
    }

    /// The server's clock, with which pages compare theirs \[s\].
    pub fn now(&self) -> f64 {
        self.state.now()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.state.is_stopping.store(true, Ordering::Release);
        self.state.hub.close();
        // The listener waits in `accept`: a connection from here wakes it.
        let address = self.state.local_address();
        let is_listener_woken = TcpStream::connect_timeout(&address, Duration::from_secs(1)).is_ok();
        if let Some(listener) = self.listener_thread.take()
            && is_listener_woken
        {
            let _ = listener.join();
        }
    }
}

impl ServerState {
    fn now(&self) -> f64 {
        self.start_instant.elapsed().as_secs_f64()
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

    fn is_stopping(&self) -> bool {
        self.is_stopping.load(Ordering::Acquire)
    }
}

/// A place among the connections or viewers; dropping it frees the place.
struct ConnectionSlot<'a>(&'a AtomicUsize);

impl<'a> ConnectionSlot<'a> {
    fn take(slots: &'a AtomicUsize, limit: usize) -> Option<Self> {
        slots
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, |n| (n < limit).then_some(n + 1))
            .ok()
            .map(|_| Self(slots))
    }
}

impl Drop for ConnectionSlot<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Connection threads need little stack: files are sent in pieces, and messages are shared.
const STACK_BYTES: usize = 512 << 10;

fn listen(listener: &TcpListener, state: &Arc<ServerState>) {
    loop {
        let accept_result = listener.accept();
        if state.is_stopping() {
            return;
        }
        let Ok((client_stream, peer_address)) = accept_result else {
            // No file descriptors are left; other connections may free some.
            thread::sleep(Duration::from_millis(10));
            continue;
        };
        let client_stream = Arc::new(client_stream);
        let pending_limit = state.options.limits.pending_connections;
        let pending_slot = state
            .pending_connections
            .admit(&client_stream, peer_address.ip(), pending_limit);
        let connection_state = state.clone();
        let counting_state = state.clone();
        let spawn_result = thread::Builder::new()
            .name("view client".into())
            .stack_size(STACK_BYTES)
            .spawn(move || connection::serve_connection(&client_stream, pending_slot, &connection_state));
        if spawn_result.is_err() {
            counting_state.counts.refused.fetch_add(1, Ordering::Relaxed);
        }
    }
}
