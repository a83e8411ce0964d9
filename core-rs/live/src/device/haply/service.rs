//! The guardian's end of the WebSocket, which sends commands and receives states. It allocates memory.

use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, HandshakeError, Message, WebSocket, client::client_with_config};

use super::line::{Waitable, is_transient, wait};
use crate::device::{DeviceLoss, FIRST_REPLY_TIMEOUT, REQUEST_RETRY_INTERVAL};
use crate::wire::haply as wire;

/// Messages that are read before the clock is checked again, because a service may send without pause.
const READS_PER_CHECK_MAX: usize = 64;

pub(super) struct Service {
    socket: WebSocket<TcpStream>,
    target: String,
    id: String,
}

/// Why the service could not be opened.
pub(super) enum OpenError {
    Refused(String),
    /// It reports no state.
    NoAnswer,
}

impl Service {
    /// Connects and waits for the first state of the device `id`, or of any device.
    pub(super) fn open(target: &str, id: Option<&str>) -> Result<(Self, wire::HaplyState), OpenError> {
        let socket = connect(target, FIRST_REPLY_TIMEOUT).map_err(OpenError::Refused)?;
        let mut service = Self {
            socket,
            target: target.to_owned(),
            id: id.unwrap_or_default().to_owned(),
        };
        let deadline = Instant::now() + FIRST_REPLY_TIMEOUT;
        while Instant::now() < deadline {
            service.wait(Instant::now() + REQUEST_RETRY_INTERVAL);
            let mut first_state = None;
            let read_result = service.read(|state| {
                first_state.get_or_insert(state);
            });
            if let Some(state) = first_state {
                service.id.clone_from(&state.id);
                return Ok((service, state));
            }
            if let Err(read_error) = read_result {
                return Err(OpenError::Refused(read_error.to_string()));
            }
        }
        Err(OpenError::NoAnswer)
    }

    /// Command a force [N]. If the service reads too slowly, the command stays in a buffer and is sent with the next
    /// one.
    pub(super) fn command(&mut self, force: [f64; 3]) -> Result<(), DeviceLoss> {
        let command = Message::text(wire::force_message(&self.id, force));
        send_result(self.socket.send(command))
    }

    /// Hand the states that are there to `visit`; returns whether there may be more.
    pub(super) fn read(&mut self, mut visit: impl FnMut(wire::HaplyState)) -> Result<bool, DeviceLoss> {
        send_result(self.socket.flush())?;
        let device_id = (!self.id.is_empty()).then_some(self.id.as_str());
        for _ in 0..READS_PER_CHECK_MAX {
            match self.socket.read() {
                Ok(Message::Text(text)) => wire::parse_state(&text, device_id).into_iter().for_each(&mut visit),
                Ok(Message::Close(_)) => return Err(DeviceLoss::Closed),
                Ok(_) => {}
                Err(Error::Io(error)) if is_transient(&error) => return Ok(false),
                Err(error) => return Err(loss_from_error(&error)),
            }
        }
        Ok(true)
    }

    pub(super) fn wait(&self, deadline: Instant) {
        wait([self.stream()], deadline);
    }

    pub(super) fn stream(&self) -> &dyn Waitable {
        self.socket.get_ref()
    }

    /// Send zero on a new connection, because the old one has ended and the force may still act.
    pub(super) fn reconnect_and_send_zero(&mut self) {
        const TIMEOUT: Duration = Duration::from_secs(1);
        if let Ok(socket) = connect(&self.target, TIMEOUT) {
            self.socket = socket;
            let _ = self.command([0.0; 3]);
        }
    }

    /// Close the WebSocket and wait briefly for the answer, which shows that all commands have arrived.
    pub(super) fn close(mut self) {
        const TIMEOUT: Duration = Duration::from_millis(200);
        let deadline = Instant::now() + TIMEOUT;
        let _ = self.socket.close(None);
        while Instant::now() < deadline && self.read(|_| ()).is_ok() {
            self.wait(deadline);
        }
    }
}

fn send_result(write_result: Result<(), Error>) -> Result<(), DeviceLoss> {
    match write_result {
        Err(Error::Io(error)) if is_transient(&error) => Ok(()),
        // The write buffer is full: the service reads nothing. `Rules` judge its silence.
        Err(Error::WriteBufferFull(_)) => Ok(()),
        other_result => other_result.map_err(|error| loss_from_error(&error)),
    }
}

fn loss_from_error(error: &Error) -> DeviceLoss {
    match error {
        Error::Io(error) => error.raw_os_error().map_or(DeviceLoss::Closed, DeviceLoss::System),
        _ => DeviceLoss::Closed,
    }
}

/// A WebSocket connection in non-blocking mode; or a sentence on why there is none.
fn connect(target: &str, timeout: Duration) -> Result<WebSocket<TcpStream>, String> {
    let address = target.strip_prefix("ws://").unwrap_or(target);
    let host_and_port = address.split('/').next().unwrap_or(address);
    let tcp_stream = connect_to_first(host_and_port, timeout).map_err(|error| error.to_string())?;
    let set_result = tcp_stream
        .set_nodelay(true)
        .and_then(|()| tcp_stream.set_write_timeout(Some(timeout)))
        .and_then(|()| tcp_stream.set_read_timeout(Some(timeout)));
    set_result.map_err(|error| error.to_string())?;
    let config = WebSocketConfig::default()
        .max_write_buffer_size(wire::MESSAGE_BYTES_MAX * 4)
        .write_buffer_size(0)
        .max_message_size(Some(wire::MESSAGE_BYTES_MAX))
        .max_frame_size(Some(wire::MESSAGE_BYTES_MAX));
    let (web_socket, _) = client_with_config(target, tcp_stream, Some(config)).map_err(|error| match error {
        HandshakeError::Failure(error) => error.to_string(),
        HandshakeError::Interrupted(_) => "it does not answer as a WebSocket".to_owned(),
    })?;
    let set_result = web_socket.get_ref().set_nonblocking(true);
    set_result.map_err(|error| error.to_string())?;
    Ok(web_socket)
}

/// Connects to the first address of `host` that can be reached.
fn connect_to_first(host_and_port: &str, timeout: Duration) -> io::Result<TcpStream> {
    let mut last_error = io::Error::from(io::ErrorKind::AddrNotAvailable);
    for address in host_and_port.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, timeout) {
            Ok(stream) => return Ok(stream),
            Err(error) => last_error = error,
        }
    }
    Err(last_error)
}
