//! A connection to a PulseAudio server: messages out, whole messages in.

use std::ffi::CStr;
use std::io::{self, Cursor, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use pulseaudio::protocol::{self, Command, CommandReply, Prop};

/// A server that does not answer for this long counts as dead.
const SERVER_TIMEOUT: Duration = Duration::from_secs(2);

/// An authorised connection.
pub(super) struct ServerConnection {
    socket: UnixStream,
    version: u16,
    serial: u32,
    /// Received bytes that are not a whole message yet.
    partial_message: Vec<u8>,
    read_buffer: Box<[u8]>,
}

/// A message: the stream that its samples belong to (`COMMAND_CHANNEL`: a command), and the bytes after its header.
pub(super) struct Message {
    channel: u32,
    bytes: Vec<u8>,
}

/// The channel of commands.
const COMMAND_CHANNEL: u32 = u32::MAX;

impl ServerConnection {
    /// Connects to the server that the environment names; starts no server. The error is a sentence.
    pub(super) fn connect(name: &CStr) -> Result<Self, String> {
        let path = socket_path()?;
        let socket = UnixStream::connect(&path).map_err(|error| match error.kind() {
            ErrorKind::NotFound | ErrorKind::ConnectionRefused => {
                format!("no PulseAudio server runs at {}", path.display())
            }
            _ => format!("no PulseAudio server at {}: {error}", path.display()),
        })?;
        let mut connection = Self {
            socket,
            version: protocol::MAX_VERSION,
            serial: 0,
            partial_message: Vec::with_capacity(1 << 16),
            read_buffer: vec![0; 1 << 16].into(),
        };
        connection
            .socket
            .set_write_timeout(Some(SERVER_TIMEOUT))
            .map_err(|error| error.to_string())?;
        let cookie = pulseaudio::cookie_path_from_env().and_then(|path| std::fs::read(path).ok());
        let auth_reply: protocol::AuthReply = connection.request(&Command::Auth(protocol::AuthParams {
            version: protocol::MAX_VERSION,
            supports_shm: false,
            supports_memfd: false,
            // The server hangs up unless the cookie has this length, even if there is none.
            cookie: cookie.unwrap_or_else(|| vec![0; 256]),
        }))?;
        connection.version = connection.version.min(auth_reply.version);
        let mut props = protocol::Props::new();
        props.set(Prop::ApplicationName, name);
        let _: protocol::SetClientNameReply = connection.request(&Command::SetClientName(props))?;
        Ok(connection)
    }

    /// Send a command; returns the serial number of its reply.
    pub(super) fn send(&mut self, command: &Command) -> Result<u32, String> {
        self.serial += 1;
        protocol::write_command_message(&mut self.socket, self.serial, command, self.version)
            .map_err(|error| error.to_string())?;
        Ok(self.serial)
    }

    /// Send a command and wait for its reply; other messages in between are skipped.
    pub(super) fn request<R: CommandReply>(&mut self, command: &Command) -> Result<R, String> {
        let command_serial = self.send(command)?;
        let deadline = Instant::now() + SERVER_TIMEOUT;
        while Instant::now() < deadline {
            let Some(message) = self.receive_message(SERVER_TIMEOUT)? else {
                continue;
            };
            match message.command(self.version) {
                Some((reply_serial, Command::Reply)) if reply_serial == command_serial => {
                    return message.reply(self.version);
                }
                Some((error_serial, Command::Error(error))) if error_serial == command_serial => {
                    return Err(format!("the PulseAudio server refuses ({error:?})"));
                }
                _ => {}
            }
        }
        Err("the PulseAudio server does not answer".into())
    }

    /// The command in a message: (number, command); `None` if it is not known here.
    pub(super) fn parse_command(&self, message: &Message) -> Option<(u32, Command)> {
        message.command(self.version)
    }

    /// The reply in a message.
    pub(super) fn parse_reply<R: CommandReply>(&self, message: &Message) -> Result<R, String> {
        message.reply(self.version)
    }

    /// Send samples to a stream.
    pub(super) fn send_samples(&mut self, channel: u32, bytes: &[u8]) -> Result<(), String> {
        protocol::write_memblock(&mut self.socket, channel, bytes, 0).map_err(|error| error.to_string())
    }

    /// The next whole message, if one comes in time.
    pub(super) fn receive_message(&mut self, read_wait: Duration) -> Result<Option<Message>, String> {
        if let Some(message) = self.complete_message()? {
            return Ok(Some(message));
        }
        let read_wait = read_wait.max(Duration::from_millis(1));
        let error_text = |error: io::Error| error.to_string();
        self.socket.set_read_timeout(Some(read_wait)).map_err(error_text)?;
        match self.socket.read(&mut self.read_buffer) {
            Ok(0) => Err("the server closed the connection".into()),
            Ok(n) => {
                self.partial_message.extend_from_slice(&self.read_buffer[..n]);
                self.complete_message()
            }
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                Ok(None)
            }
            Err(error) => Err(error.to_string()),
        }
    }

    fn complete_message(&mut self) -> Result<Option<Message>, String> {
        let Some(header) = self.partial_message.get(..protocol::DESCRIPTOR_SIZE) else {
            return Ok(None);
        };
        let header = protocol::read_descriptor(&mut Cursor::new(header)).map_err(|error| error.to_string())?;
        let message_end = protocol::DESCRIPTOR_SIZE + header.length as usize;
        if self.partial_message.len() < message_end {
            return Ok(None);
        }
        let message = Message {
            channel: header.channel,
            bytes: self.partial_message[protocol::DESCRIPTOR_SIZE..message_end].to_vec(),
        };
        self.partial_message.drain(..message_end);
        Ok(Some(message))
    }
}

impl Drop for ServerConnection {
    fn drop(&mut self) {
        let _ = self.socket.flush();
        let _ = self.socket.shutdown(std::net::Shutdown::Both);
    }
}

impl Message {
    /// The stream whose samples these are; `None`: a command.
    pub(super) fn channel(&self) -> Option<u32> {
        (self.channel != COMMAND_CHANNEL).then_some(self.channel)
    }

    /// The bytes after the header.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    fn command(&self, version: u16) -> Option<(u32, Command)> {
        if self.channel != COMMAND_CHANNEL {
            return None;
        }
        Command::read_tag_prefixed(&mut Cursor::new(&self.bytes), version).ok()
    }

    fn reply<R: CommandReply>(&self, version: u16) -> Result<R, String> {
        let mut cursor = Cursor::new(&self.bytes);
        Command::read_tag_prefixed(&mut cursor, version)
            .and_then(|_| protocol::TagStructReader::new(&mut cursor, version).read())
            .map_err(|error| format!("the answer of the PulseAudio server cannot be parsed: {error}"))
    }
}

/// The path of the server's socket: PULSE_SERVER, else the places where PulseAudio itself looks.
fn socket_path() -> Result<PathBuf, String> {
    let variable = |name| std::env::var(name).ok().filter(|text| !text.is_empty());
    if let Some(server_list) = variable("PULSE_SERVER") {
        // It may list several servers; each may begin with a {machine id}.
        let local_path = server_list.split_whitespace().find_map(|address| {
            let address = address.rsplit_once('}').map_or(address, |(_, address)| address);
            let path = address.strip_prefix("unix:").unwrap_or(address);
            path.starts_with('/').then(|| path.into())
        });
        return local_path
            .ok_or_else(|| format!("PULSE_SERVER={server_list} names no server on this machine (unix:/path)"));
    }
    let runtime_socket = variable("PULSE_RUNTIME_PATH").map(|path| PathBuf::from(path).join("native"));
    let user_socket = variable("XDG_RUNTIME_DIR").map(|path| PathBuf::from(path).join("pulse/native"));
    let system_socket = Some(PathBuf::from("/var/run/pulse/native"));
    let socket_places = [runtime_socket, user_socket, system_socket].into_iter().flatten();
    socket_places
        .into_iter()
        .find(|path| path.exists())
        .ok_or_else(|| "no PulseAudio server runs".into())
}
