//! How a host starts the guardian of its Haply, and how the two connect.

use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{PoisonError, RwLock};
use std::time::{Duration, Instant};

use super::line::LineStream;

/// Longest time for a guardian to end after its host let go; its own waits are shorter.
const GUARDIAN_EXIT_TIMEOUT: Duration = Duration::from_secs(3);
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// A program that calls [`serve`](super::guardian::serve) and then ends.
#[derive(Clone, Debug)]
pub struct GuardianProgram {
    /// The path of the program.
    pub path: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
}

static GUARDIAN_PROGRAM: RwLock<Option<GuardianProgram>> = RwLock::new(None);

/// Set the program that guards a Haply, once in a process; without it no Haply can be opened.
pub fn register_program(program: GuardianProgram) {
    *GUARDIAN_PROGRAM.write().unwrap_or_else(PoisonError::into_inner) = Some(program);
}

/// A running guardian. It ends when the line to it is closed; dropping this waits for its end.
pub(super) struct GuardianProcess(Child);

impl Drop for GuardianProcess {
    fn drop(&mut self) {
        let deadline = Instant::now() + GUARDIAN_EXIT_TIMEOUT;
        while matches!(self.0.try_wait(), Ok(None)) {
            if Instant::now() >= deadline {
                let _ = self.0.kill();
                let _ = self.0.wait();
                return;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

/// Start a guardian, which waits for its host's first message.
pub(super) fn start() -> io::Result<(LineStream, GuardianProcess)> {
    let program = GUARDIAN_PROGRAM.read().unwrap_or_else(PoisonError::into_inner).clone();
    let program =
        program.ok_or_else(|| io::Error::other("a Haply needs a guardian process, which this program cannot start"))?;
    let mut command = Command::new(&program.path);
    command
        .args(&program.arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let started = launch(command);
    started.map_err(|error| {
        let program_path = program.path.display();
        io::Error::new(error.kind(), format!("its guardian process ({program_path}): {error}"))
    })
}

/// The guardian's standard input is one end of a socket pair; Ctrl-C in the host's terminal does not reach it.
#[cfg(unix)]
fn launch(mut command: Command) -> io::Result<(LineStream, GuardianProcess)> {
    use std::os::fd::OwnedFd;
    use std::os::unix::process::CommandExt;

    let (parent_stream, child_stream) = LineStream::pair()?;
    let child_process = command
        .stdin(Stdio::from(OwnedFd::from(child_stream)))
        .process_group(0)
        .spawn()?;
    Ok((parent_stream, GuardianProcess(child_process)))
}

/// The guardian's end of the line.
#[cfg(unix)]
pub(super) fn inherited_stream() -> io::Result<LineStream> {
    use std::os::fd::AsFd;

    let host_stream = LineStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    // Fails if the standard input is not a socket.
    host_stream.peer_addr().map(|_| host_stream)
}

#[cfg(not(unix))]
fn launch(mut command: Command) -> io::Result<(LineStream, GuardianProcess)> {
    #[cfg(windows)]
    {
        use std::os::windows::process::CommandExt;
        const CREATE_NEW_PROCESS_GROUP: u32 = 0x200;
        const CREATE_NO_WINDOW: u32 = 0x0800_0000;
        command.creation_flags(CREATE_NEW_PROCESS_GROUP | CREATE_NO_WINDOW);
    }
    let (meeting, address) = loopback::Rendezvous::new()?;
    let mut child_process = command.stdin(Stdio::piped()).spawn()?;
    let child_input = child_process.stdin.take();
    let mut started = GuardianProcess(child_process);
    if let Some(mut child_input) = child_input {
        io::Write::write_all(&mut child_input, &address)?;
    }
    let guardian_stream = meeting.wait(|| matches!(started.0.try_wait(), Ok(None)))?;
    Ok((guardian_stream, started))
}

#[cfg(not(unix))]
pub(super) fn inherited_stream() -> io::Result<LineStream> {
    loopback::join(&mut io::stdin().lock())
}

/// Replacement where there are no socket pairs: a local connection with a token that only host and guardian know.
#[cfg(any(not(unix), test))]
mod loopback {
    use std::hash::{BuildHasher, RandomState};
    use std::io::{self, Read, Write};
    use std::net::{Ipv4Addr, TcpListener, TcpStream};
    use std::time::{Duration, Instant};

    /// Two bytes of port, 16 of token.
    const ADDRESS_BYTES: usize = 18;
    const CONNECT_TIMEOUT: Duration = Duration::from_secs(15);
    /// Longest wait for the token of an unknown peer.
    const TOKEN_TIMEOUT: Duration = Duration::from_millis(200);
    const POLL_INTERVAL: Duration = Duration::from_millis(2);

    pub(super) struct Rendezvous {
        listener: TcpListener,
        token: [u8; ADDRESS_BYTES - 2],
    }

    impl Rendezvous {
        /// The meeting point, and the bytes that the other side needs to find it.
        pub(super) fn new() -> io::Result<(Self, [u8; ADDRESS_BYTES])> {
            let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
            listener.set_nonblocking(true)?;
            // The keys of a new hasher come from the system's random numbers.
            let random_bytes = || RandomState::new().hash_one(0).to_le_bytes();
            let mut address = [0; ADDRESS_BYTES];
            address[..2].copy_from_slice(&listener.local_addr()?.port().to_le_bytes());
            address[2..10].copy_from_slice(&random_bytes());
            address[10..].copy_from_slice(&random_bytes());
            let mut token = [0; ADDRESS_BYTES - 2];
            token.copy_from_slice(&address[2..]);
            Ok((Self { listener, token }, address))
        }

        /// Wait for the peer that knows the token, as long as `lives` is true.
        pub(super) fn wait(self, mut lives: impl FnMut() -> bool) -> io::Result<TcpStream> {
            let deadline = Instant::now() + CONNECT_TIMEOUT;
            while lives() && Instant::now() < deadline {
                let Ok((mut peer_stream, _)) = self.listener.accept() else {
                    std::thread::sleep(POLL_INTERVAL);
                    continue;
                };
                peer_stream.set_nonblocking(false)?;
                peer_stream.set_read_timeout(Some(TOKEN_TIMEOUT))?;
                let mut peer_token = [0; ADDRESS_BYTES - 2];
                if peer_stream.read_exact(&mut peer_token).is_ok() && peer_token == self.token {
                    peer_stream.set_nodelay(true)?;
                    return Ok(peer_stream);
                }
            }
            Err(io::ErrorKind::TimedOut.into())
        }
    }

    /// Connect to the meeting point that `address` describes.
    pub(super) fn join(address: &mut impl Read) -> io::Result<TcpStream> {
        let mut address_bytes = [0; ADDRESS_BYTES];
        address.read_exact(&mut address_bytes)?;
        let host_port = u16::from_le_bytes([address_bytes[0], address_bytes[1]]);
        let mut host_stream = TcpStream::connect((Ipv4Addr::LOCALHOST, host_port))?;
        host_stream.set_nodelay(true)?;
        host_stream.write_all(&address_bytes[2..])?;
        Ok(host_stream)
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn rendezvous_meets_holders_of_the_token_only() {
            let (meeting, address) = Rendezvous::new().unwrap();
            let mut wrong_address = address;
            wrong_address[17] ^= 1;
            let _stranger = join(&mut &wrong_address[..]).unwrap();
            let mut friend_stream = join(&mut &address[..]).unwrap();
            let mut met_stream = meeting.wait(|| true).unwrap();
            friend_stream.write_all(b"here").unwrap();
            let mut met_bytes = [0; 4];
            met_stream.read_exact(&mut met_bytes).unwrap();
            assert_eq!(&met_bytes, b"here");
        }

        #[test]
        fn rendezvous_with_a_dead_service_ends() {
            let (meeting, _) = Rendezvous::new().unwrap();
            assert!(meeting.wait(|| false).is_err());
        }
    }
}
