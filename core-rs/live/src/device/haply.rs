//! Haply's Inverse Service: one device of three axes behind a WebSocket.
//!
//! JSON and WebSockets allocate, so they have a thread of their own; between it and the physics are two triple
//! buffers. A host that stops sending is noticed there, and the device then gets zero forces: the service keeps no
//! watch of its own that is documented.

use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Message, WebSocket, client::client_with_config};

use super::wire::haply as wire;
use super::{
    Device, DeviceError, FIRST_REPLY, Gone, LOCKSTEP_PATIENCE, MAX_AXES, Sample, Spec, Stats, Unit,
    Url,
};
use crate::safety::SafeForce;

/// Silence of the host after which the thread sends zero forces.
const HOST_SILENT: Duration = Duration::from_millis(50);
/// How often a lockstep host looks whether the reply is there.
const LOOK: Duration = Duration::from_micros(20);

type Socket = WebSocket<TcpStream>;

/// To the thread: forces and their number.
#[derive(Clone, Copy, Default)]
struct Order {
    force: [f64; 3],
    seq: u32,
}

/// From it: where the device was when it answered that order.
#[derive(Clone, Copy, Default)]
struct Answer {
    position: [f64; 3],
    seq: u32,
    round_trip: Duration,
}

pub(super) struct Haply {
    spec: Spec,
    lockstep: bool,
    orders: triple_buffer::Input<Order>,
    answers: triple_buffer::Output<Answer>,
    seq: u32,
    seen: u32,
    /// The first position is still to be taken.
    new: bool,
    line: Arc<Line>,
    thread: Option<JoinHandle<()>>,
    stats: Stats,
}

/// What both sides know of the line.
#[derive(Default)]
struct Line {
    closing: AtomicBool,
    broken: AtomicBool,
}

/// Of an Inverse3, as a community driver lists it; its mass and friction are for metrology to find.
fn spec() -> Spec {
    Spec {
        dof: 3,
        unit: Unit::Metre,
        pos_lsb: 1e-5,
        pos_range: [-0.15, 0.15],
        force_max_continuous: 5.0,
        force_max_peak: 10.0,
        force_lsb: 1e-3,
        rate_nominal: None,
        loop_delay_s: None,
        inertia: None,
        damping: None,
        touch_gated: false,
        can_lockstep: true,
        can_wide: false,
    }
}

impl Haply {
    pub(super) fn open(url: &Url) -> Result<Self, DeviceError> {
        if url.wide {
            return Err(url.cannot("its numbers are text already; wide is for frames"));
        }
        let mut socket = connect(url)?;
        let wanted = url.text("id");
        let first = read(&mut socket, wanted).map_err(|gone| url.closed(gone))?;
        let first = first.ok_or_else(|| url.no_answer("Haply device"))?;
        let (orders, mut new_orders) = triple_buffer::triple_buffer(&Order::default());
        let seen = Answer {
            position: first.position,
            ..Answer::default()
        };
        let (mut new_answers, answers) = triple_buffer::triple_buffer(&seen);
        let line = Arc::new(Line::default());
        let thread = std::thread::Builder::new().name("haply".to_owned()).spawn({
            let line = line.clone();
            move || {
                let mut talk = Talk {
                    socket,
                    id: first.id,
                };
                let end = talk.serve(&mut new_orders, &mut new_answers, &line);
                if end.is_err() {
                    line.broken.store(true, Ordering::Release);
                }
                let _ = talk.exchange([0.0; 3]);
                let _ = talk.socket.close(None);
            }
        });
        Ok(Self {
            spec: spec(),
            lockstep: url.lockstep,
            orders,
            answers,
            seq: 0,
            seen: 0,
            new: true,
            line,
            thread: Some(thread.map_err(|error| url.closed(error))?),
            stats: Stats::default(),
        })
    }

    fn give(&mut self, force: [f64; 3]) {
        self.seq = self.seq.wrapping_add(1);
        self.orders.write(Order {
            force,
            seq: self.seq,
        });
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
        self.stats.sent += 1;
    }
}

fn connect(url: &Url) -> Result<Socket, DeviceError> {
    let address = url.target.strip_prefix("ws://");
    let address =
        address.ok_or_else(|| url.cannot("an address looks like ws://127.0.0.1:10001"))?;
    let host = address.split('/').next().unwrap_or(address);
    let stream = TcpStream::connect(host).map_err(|error| url.closed(error))?;
    let set = stream
        .set_nodelay(true)
        .and_then(|()| stream.set_read_timeout(Some(FIRST_REPLY)));
    set.map_err(|error| url.closed(error))?;
    let config = WebSocketConfig::default()
        .max_message_size(Some(wire::LONGEST))
        .max_frame_size(Some(wire::LONGEST));
    let (socket, _) = client_with_config(url.target.as_str(), stream, Some(config))
        .map_err(|error| url.closed(error))?;
    Ok(socket)
}

/// The next state the service tells, passing over what tells none.
fn read(socket: &mut Socket, id: Option<&str>) -> Result<Option<wire::State>, Gone> {
    let patience = Instant::now() + FIRST_REPLY;
    while Instant::now() < patience {
        match socket.read() {
            Ok(Message::Text(text)) => {
                if let Some(state) = wire::parse_state(&text, id) {
                    return Ok(Some(state));
                }
            }
            Ok(Message::Close(_)) => return Err(Gone::Closed),
            Ok(_) => {}
            Err(tungstenite::Error::Io(error)) => match error.kind() {
                std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut => return Ok(None),
                _ => return Err(Gone::System(error.raw_os_error().unwrap_or(0))),
            },
            Err(_) => return Err(Gone::Closed),
        }
    }
    Ok(None)
}

/// The thread's side of the line.
struct Talk {
    socket: Socket,
    id: String,
}

impl Talk {
    fn serve(
        &mut self,
        orders: &mut triple_buffer::Output<Order>,
        answers: &mut triple_buffer::Input<Answer>,
        line: &Line,
    ) -> Result<(), Gone> {
        let (mut heard, mut let_go) = (Instant::now(), true);
        while !line.closing.load(Ordering::Acquire) {
            if orders.update() {
                let order = *orders.output_buffer();
                let start = Instant::now();
                let position = self.exchange(order.force)?;
                answers.write(Answer {
                    position,
                    seq: order.seq,
                    round_trip: start.elapsed(),
                });
                (heard, let_go) = (Instant::now(), false);
            } else if heard.elapsed() < HOST_SILENT || let_go {
                // Woken by the next order; one that came meanwhile wakes at once.
                std::thread::park_timeout(HOST_SILENT);
            } else {
                self.exchange([0.0; 3])?;
                let_go = true;
            }
        }
        Ok(())
    }

    fn exchange(&mut self, force: [f64; 3]) -> Result<[f64; 3], Gone> {
        let command = wire::command(&self.id, force);
        let sent = self.socket.send(Message::text(command));
        sent.map_err(|_| Gone::Closed)?;
        let state = read(&mut self.socket, Some(&self.id))?.ok_or(Gone::Silent)?;
        Ok(state.position)
    }
}

impl Device for Haply {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
        if self.line.broken.load(Ordering::Acquire) {
            return Err(Gone::Closed);
        }
        let of = |axis: usize| force.newtons().get(axis).copied().unwrap_or(0.0);
        self.give([of(0), of(1), of(2)]);
        Ok(())
    }

    fn receive(&mut self, into: &mut Sample, deadline: Instant) -> Result<bool, Gone> {
        let until = if self.lockstep {
            Instant::now() + LOCKSTEP_PATIENCE
        } else {
            deadline
        };
        let answer = loop {
            let answer = *self.answers.read();
            let wanted = if self.new || self.lockstep {
                answer.seq == self.seq
            } else {
                answer.seq != self.seen
            };
            if wanted {
                break answer;
            }
            if self.line.broken.load(Ordering::Acquire) {
                return Err(Gone::Closed);
            }
            if Instant::now() >= until {
                if self.lockstep {
                    return Err(Gone::Silent);
                }
                break answer;
            }
            std::thread::sleep(LOOK);
        };
        into.fresh = answer.seq != self.seen;
        if into.fresh {
            self.stats.received += 1;
            self.stats.lost += u64::from(answer.seq.wrapping_sub(self.seen) - 1);
            self.stats.timed(answer.round_trip);
            self.seen = answer.seq;
        }
        into.position[..3].copy_from_slice(&answer.position);
        into.fresh |= std::mem::take(&mut self.new);
        (into.touch, into.force_enabled) = ([true; MAX_AXES], [true; MAX_AXES]);
        (into.hot, into.let_go) = (false, false); // it does not say
        into.seq = answer.seq;
        Ok(into.fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.lockstep
    }

    fn zero(&mut self) {
        self.give([0.0; 3]);
    }

    fn stats(&self) -> Stats {
        self.stats
    }
}

impl Drop for Haply {
    fn drop(&mut self) {
        self.line.closing.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}
