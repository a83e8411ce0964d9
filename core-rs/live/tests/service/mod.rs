//! A Haply service that stops answering at the request of a test, and logs every force that it receives.

use std::io::ErrorKind;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ergon_live::wire::haply;
use tungstenite::Message;

const ID: &str = "TEST";
/// How long a test waits for an expected event: a busy machine is slow, not wrong.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// How the service replies to a command.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(u8)]
pub(crate) enum Reply {
    /// With its state.
    State,
    /// Not at all until it receives a force of zero; then with its state again.
    SilentUntilZero,
    /// With `{}` until it receives a force of zero; then with its state again.
    EmptyUntilZero,
    /// Never again.
    Never,
    /// By closing the connection without a word; the next connection gets states.
    HangUp,
}

const REPLIES: [Reply; 5] = [
    Reply::State,
    Reply::SilentUntilZero,
    Reply::EmptyUntilZero,
    Reply::Never,
    Reply::HangUp,
];

/// An event at the service.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ServiceEvent {
    Came,
    Force([f64; 3]),
    /// The host closed its connection, or the connection was lost.
    Left,
}

pub(crate) struct Service {
    pub(crate) url: String,
    pub(crate) events: Receiver<ServiceEvent>,
    reply: Arc<AtomicU8>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Service {
    pub(crate) fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let url = format!("haply:ws://{}", listener.local_addr().unwrap());
        let (reply, over) = (Arc::new(AtomicU8::new(0)), Arc::new(AtomicBool::new(false)));
        let (tell, output) = channel();
        let thread = std::thread::spawn({
            let (reply, over) = (reply.clone(), over.clone());
            move || {
                while !over.load(Ordering::Relaxed) {
                    match listener.accept() {
                        Ok((stream, _)) => serve(stream, &tell, &reply, &over),
                        Err(_) => std::thread::sleep(Duration::from_millis(1)),
                    }
                }
            }
        });
        Self {
            url,
            events: output,
            reply,
            over,
            thread: Some(thread),
        }
    }

    pub(crate) fn reply(&self, how: Reply) {
        self.reply.store(how as u8, Ordering::Relaxed);
    }

    /// Wait for an event at the service.
    pub(crate) fn until(&self, wanted: impl Fn(ServiceEvent) -> bool) {
        while !wanted(self.events.recv_timeout(PATIENCE).expect("it is told")) {}
    }

    pub(crate) fn until_pushed(&self) {
        self.until(|told| matches!(told, ServiceEvent::Force([x, ..]) if x > 0.0));
    }

    pub(crate) fn until_zero(&self) {
        self.until(|told| told == ServiceEvent::Force([0.0; 3]));
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

/// Serve one host until it leaves.
fn serve(stream: std::net::TcpStream, tell: &Sender<ServiceEvent>, reply: &AtomicU8, over: &AtomicBool) {
    stream.set_nonblocking(false).unwrap();
    stream.set_nodelay(true).unwrap();
    let Ok(mut socket) = tungstenite::accept(stream) else {
        return;
    };
    let quick = Some(Duration::from_millis(5));
    socket.get_ref().set_read_timeout(quick).unwrap();
    let state = |force| Message::text(haply::state_message(ID, [0.01, 0.0, 0.0], force, false));
    let _ = tell.send(ServiceEvent::Came);
    let _ = socket.send(state([0.0; 3]));
    while !over.load(Ordering::Relaxed) {
        let force = match socket.read() {
            Ok(Message::Text(text)) => haply::parse_command(&text, ID),
            Ok(Message::Close(_)) => break,
            Ok(_) => None,
            Err(tungstenite::Error::Io(error))
                if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) =>
            {
                None
            }
            Err(_) => break,
        };
        let Some(force) = force else { continue };
        let _ = tell.send(ServiceEvent::Force(force));
        let how = REPLIES[usize::from(reply.load(Ordering::Relaxed))];
        if force == [0.0; 3] && matches!(how, Reply::SilentUntilZero | Reply::EmptyUntilZero) {
            reply.store(Reply::State as u8, Ordering::Relaxed);
        }
        match REPLIES[usize::from(reply.load(Ordering::Relaxed))] {
            Reply::State => drop(socket.send(state(force))),
            Reply::EmptyUntilZero => drop(socket.send(Message::text("{}"))),
            Reply::SilentUntilZero | Reply::Never => {}
            Reply::HangUp => {
                reply.store(Reply::State as u8, Ordering::Relaxed);
                break;
            }
        }
    }
    let _ = tell.send(ServiceEvent::Left);
}
