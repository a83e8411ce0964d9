//! A client of a JACK server: opening, callbacks for server events, closing.

use std::ffi::{CStr, CString, c_char, c_int, c_uint, c_ulong, c_void};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use super::api::{self, Api, LatencyRange, RawClient, RawPort};
use super::registry::{Connection, Registry};
use crate::audio::AudioError;
use crate::audio::stream_state::StreamState;
use crate::realtime;

/// State that the server's own threads update; atomics only.
struct ServerEvents {
    stream_state: Arc<StreamState>,
    server_ended: AtomicBool,
    rate: AtomicU32,
    block: AtomicU32,
}

/// A process callback.
pub(super) trait ProcessCallback: Send + 'static {
    /// One cycle of the server. No allocation, lock or panic; waits only while the server freewheels.
    fn process(&mut self, cycle: &ProcessCycle<'_>);
}

struct CallbackContext<P> {
    api: &'static Api,
    ports: Box<[Port]>,
    callback: P,
}

static CLIENTS: Registry<OpenClient> = Registry::new();

/// What `CLIENTS` closes.
struct OpenClient {
    api: &'static Api,
    handle: *mut RawClient,
    events: ServerEvents,
}

// SAFETY: `handle` is used from any thread, but only while `CLIENTS` is locked and has the client.
unsafe impl Send for OpenClient {}
// SAFETY: as above.
unsafe impl Sync for OpenClient {}

impl Connection for OpenClient {
    fn has_server_ended(&self) -> bool {
        self.events.server_ended.load(Ordering::Acquire)
    }

    fn close(&self) {
        // SAFETY: open, and closed by `CLIENTS` alone, once; no callback runs when this returns.
        unsafe {
            (self.api.deactivate)(self.handle);
            (self.api.client_close)(self.handle);
        }
        self.events.server_ended.store(true, Ordering::Release);
    }
}

/// A client, closed when dropped, or when another one is opened after the server has ended.
pub(super) struct Client {
    open_client: Arc<OpenClient>,
    opening_rate: u32,
}

/// A port of a client; valid while the client is open.
#[derive(Clone, Copy)]
pub(super) struct Port(*mut RawPort);

// SAFETY: libjack takes ports from any thread.
unsafe impl Send for Port {}
// SAFETY: as above.
unsafe impl Sync for Port {}

/// One cycle of the server, as the process callback sees it.
pub(super) struct ProcessCycle<'a> {
    api: &'a Api,
    ports: &'a [Port],
    frames: u32,
}

impl ProcessCycle<'_> {
    /// Frames of the cycle.
    pub(super) fn frames(&self) -> usize {
        self.frames as usize
    }

    /// Writes interleaved frames to our ports, from frame `first` of the cycle on.
    pub(super) fn write(&self, first: usize, frames: &[f32]) {
        let channels = self.ports.len();
        let frame_count = (frames.len() / channels).min(self.frames() - first);
        for (channel, buffer) in self.buffers() {
            // SAFETY: an output port's buffer of as many floats as the cycle has frames, ours alone in this cycle.
            let port_buffer = unsafe { std::slice::from_raw_parts_mut(buffer.add(first), frame_count) };
            for (x, frame) in port_buffer.iter_mut().zip(frames.chunks_exact(channels)) {
                *x = frame[channel];
            }
        }
    }

    /// Fills interleaved frames from our ports, from frame `first` of the cycle on.
    pub(super) fn read(&self, first: usize, frames: &mut [f32]) {
        let channels = self.ports.len();
        let frame_count = (frames.len() / channels).min(self.frames() - first);
        for (channel, buffer) in self.buffers() {
            // SAFETY: an input port's buffer of as many floats as the cycle has frames, which nobody writes now.
            let port_buffer = unsafe { std::slice::from_raw_parts(buffer.add(first), frame_count) };
            for (frame, x) in frames.chunks_exact_mut(channels).zip(port_buffer) {
                frame[channel] = *x;
            }
        }
    }

    /// The channels whose port has a buffer in this cycle.
    fn buffers(&self) -> impl Iterator<Item = (usize, *mut f32)> {
        let port_buffer = |port: &Port| {
            // SAFETY: a port of this client, in its process callback.
            unsafe { (self.api.port_get_buffer)(port.0, self.frames) }.cast::<f32>()
        };
        let buffers = self.ports.iter().map(port_buffer).enumerate();
        buffers.filter(|(_, port_buffer)| !port_buffer.is_null())
    }
}

/// Attempts to open a client on a server that is too busy; each attempt waits some seconds.
const OPEN_ATTEMPTS: usize = 4;

/// Calls `open` until it succeeds; tries again if its status says that the server is there but too busy.
fn open_with_retries<T>(mut open: impl FnMut(&mut c_uint) -> Option<T>) -> Result<T, AudioError> {
    let mut jack_status = 0;
    for _ in 0..OPEN_ATTEMPTS {
        jack_status = 0;
        if let Some(client) = open(&mut jack_status) {
            return Ok(client);
        }
        if jack_status & api::SERVER_FAILED != 0 || jack_status & api::SERVER_ERROR == 0 {
            break;
        }
    }
    let reason = if jack_status & api::SERVER_FAILED != 0 {
        "no JACK server runs".into()
    } else if jack_status & api::SERVER_ERROR != 0 {
        "the JACK server is too busy to accept a client".into()
    } else {
        format!("the JACK server refuses (status {jack_status:#x})")
    };
    Err(AudioError::Unavailable {
        backend: "jack",
        reason,
    })
}

impl Client {
    /// Connects to the running server; starts no server.
    pub(super) fn open(name: &CStr, stream_state: Arc<StreamState>) -> Result<Self, AudioError> {
        let api = api::api()?;
        let open_client = CLIENTS.open(|| {
            let raw = open_with_retries(|status| {
                // SAFETY: both pointers live through the call; no option that needs a further argument is given.
                let raw = unsafe { (api.client_open)(name.as_ptr(), api::NO_START_SERVER, status) };
                (!raw.is_null()).then_some(raw)
            })?;
            // SAFETY: the client is open, and nobody else has it yet.
            let (server_rate, server_block) = unsafe { ((api.get_sample_rate)(raw), (api.get_buffer_size)(raw)) };
            Ok(OpenClient {
                api,
                handle: raw,
                events: ServerEvents {
                    stream_state,
                    server_ended: AtomicBool::new(false),
                    rate: AtomicU32::new(server_rate),
                    block: AtomicU32::new(server_block),
                },
            })
        })?;
        let opening_rate = open_client.events.rate.load(Ordering::Acquire);
        let client = Self {
            open_client,
            opening_rate,
        };
        client.register_callbacks();
        Ok(client)
    }

    /// Calls a function of libjack on the client, which stays open through the call; nothing if it is closed.
    fn call<T>(&self, call: impl FnOnce(&Api, *mut RawClient) -> T) -> Option<T> {
        let open_client = &self.open_client;
        CLIENTS.call(open_client, || call(open_client.api, open_client.handle))
    }

    fn register_callbacks(&self) {
        let events_pointer = (&raw const self.open_client.events).cast_mut().cast();
        // SAFETY: `events` lives in `open_client`, which is closed before it is dropped.
        self.call(|api, raw| unsafe {
            (api.on_thread)(raw, on_thread_start, events_pointer);
            (api.on_xrun)(raw, on_xrun, events_pointer);
            (api.on_buffer_size)(raw, on_buffer_size, events_pointer);
            (api.on_sample_rate)(raw, on_sample_rate, events_pointer);
            (api.on_freewheel)(raw, on_freewheel, events_pointer);
            (api.on_shutdown)(raw, on_shutdown, events_pointer);
        });
    }

    pub(super) fn stream_state(&self) -> &StreamState {
        &self.open_client.events.stream_state
    }

    /// Whether the server still runs, at the rate that it had.
    pub(super) fn is_alive(&self) -> bool {
        !self.open_client.has_server_ended() && self.rate() == self.opening_rate
    }

    pub(super) fn rate(&self) -> u32 {
        self.open_client.events.rate.load(Ordering::Acquire)
    }

    pub(super) fn block(&self) -> u32 {
        self.open_client.events.block.load(Ordering::Acquire)
    }

    /// The name that the server gave the client; it differs from ours if that was taken.
    pub(super) fn name(&self) -> String {
        // SAFETY: the client is open; the name lives as long.
        self.call(|api, raw| unsafe { c_string_text((api.get_client_name)(raw)) })
            .unwrap_or_default()
    }

    /// Ports named `prefix_1` to `prefix_n`.
    fn ports(&self, prefix: &str, n: usize, direction: c_ulong) -> Result<Box<[Port]>, AudioError> {
        let port = |i| {
            let port_name = CString::new(format!("{prefix}_{i}")).unwrap_or_default();
            // SAFETY: the client is open, the strings live through the call.
            let port = self.call(|api, raw| unsafe {
                (api.port_register)(raw, port_name.as_ptr(), api::AUDIO_PORT_TYPE.as_ptr(), direction, 0)
            });
            let port = port.unwrap_or(ptr::null_mut());
            if port.is_null() {
                let reason = format!("the JACK server refused the port {prefix}_{i}");
                return Err(AudioError::Unavailable {
                    backend: "jack",
                    reason,
                });
            }
            Ok(Port(port))
        };
        (1..=n).map(port).collect()
    }

    /// Names of the ports that match a pattern (empty: all) and have these properties.
    pub(super) fn find(&self, pattern: &str, flags: c_ulong) -> Vec<String> {
        let pattern = CString::new(pattern).unwrap_or_default();
        // SAFETY: the client is open; what comes back is null or a list of strings that a null ends, ours to free.
        let port_names = self.call(|api, raw| unsafe {
            let mut port_names = Vec::new();
            let name_list = (api.get_ports)(raw, pattern.as_ptr(), api::AUDIO_PORT_TYPE.as_ptr(), flags);
            let mut list_entry = name_list;
            while !list_entry.is_null() && !(*list_entry).is_null() {
                port_names.push(c_string_text(*list_entry));
                list_entry = list_entry.add(1);
            }
            if !name_list.is_null() {
                (api.free)(name_list.cast());
            }
            port_names
        });
        port_names.unwrap_or_default()
    }

    /// Connect two ports by name; whether they are connected now.
    pub(super) fn connect(&self, source_name: &str, target_name: &str) -> bool {
        const ALREADY_CONNECTED: c_int = 17;
        let (Ok(source_name), Ok(target_name)) = (CString::new(source_name), CString::new(target_name)) else {
            return false;
        };
        // SAFETY: the client is open, the strings live through the call.
        let connect_status =
            self.call(|api, raw| unsafe { (api.connect)(raw, source_name.as_ptr(), target_name.as_ptr()) });
        connect_status.is_some_and(|connect_status| connect_status == 0 || connect_status == ALREADY_CONNECTED)
    }

    /// Switch the freewheel mode of the server, in which it runs as fast as its clients; returns whether the server
    /// accepted.
    pub(super) fn set_freewheel(&self, is_on: bool) -> bool {
        // SAFETY: the client is open.
        self.call(|api, raw| unsafe { (api.set_freewheel)(raw, is_on.into()) }) == Some(0)
    }

    /// Start: `process_callback` is called for every cycle until the client is closed, with ports `prefix_1` to
    /// `prefix_n`.
    pub(super) fn activate<P: ProcessCallback>(
        self,
        prefix: &str,
        n: usize,
        direction: c_ulong,
        process_callback: P,
    ) -> Result<ActiveClient<P>, (P, AudioError)> {
        let ports = match self.ports(prefix, n, direction) {
            Ok(ports) => ports,
            Err(error) => return Err((process_callback, error)),
        };
        let callback = Box::new(CallbackContext {
            api: self.open_client.api,
            ports: ports.clone(),
            callback: process_callback,
        });
        let callback = Box::into_raw(callback);
        // SAFETY: the callback is freed only after the client is closed (`ActiveClient::close`).
        let activate_status = self.call(|api, raw| unsafe {
            (api.on_process)(raw, on_cycle::<P>, callback.cast());
            (api.activate)(raw)
        });
        let active_client = ActiveClient {
            client: Some(self),
            ports,
            callback,
        };
        if activate_status == Some(0) {
            return Ok(active_client);
        }
        let reason = "the JACK server refused to activate the client".into();
        let error = AudioError::Unavailable {
            backend: "jack",
            reason,
        };
        Err((active_client.close(), error))
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        CLIENTS.close(&self.open_client);
    }
}

/// A client with a running callback.
pub(super) struct ActiveClient<P: ProcessCallback> {
    client: Option<Client>,
    ports: Box<[Port]>,
    callback: *mut CallbackContext<P>,
}

// SAFETY: the callback is `Send`, and touched only by the server's thread until that has ended.
unsafe impl<P: ProcessCallback> Send for ActiveClient<P> {}
// SAFETY: by reference, only the client can be reached.
unsafe impl<P: ProcessCallback> Sync for ActiveClient<P> {}

impl<P: ProcessCallback> ActiveClient<P> {
    pub(super) fn client(&self) -> &Client {
        self.client.as_ref().expect("it is open until it is closed")
    }

    /// The names of our ports.
    pub(super) fn port_names(&self) -> Vec<String> {
        let names = self.client().call(|api, _| {
            // SAFETY: the ports are of this open client.
            let port_name = |port: &Port| unsafe { c_string_text((api.port_name)(port.0)) };
            self.ports.iter().map(port_name).collect()
        });
        names.unwrap_or_default()
    }

    /// Frames from our first port to the loudspeaker, or from the microphone to it, as the server reports.
    pub(super) fn latency(&self, direction: c_uint) -> u32 {
        let mut latency_range = LatencyRange::default();
        if let Some(first_port) = self.ports.first() {
            // SAFETY: the port is one of this open client; the range lives through the call.
            self.client().call(|api, _| unsafe {
                (api.port_get_latency_range)(first_port.0, direction, &raw mut latency_range);
            });
        }
        latency_range.max
    }

    /// Close the client and return its `callback`.
    pub(super) fn close(mut self) -> P {
        self.client = None;
        let callback = std::mem::replace(&mut self.callback, ptr::null_mut());
        // SAFETY: made by `Box::into_raw`, taken once, and the client that used it is closed.
        unsafe { Box::from_raw(callback) }.callback
    }
}

impl<P: ProcessCallback> Drop for ActiveClient<P> {
    fn drop(&mut self) {
        self.client = None;
        if !self.callback.is_null() {
            // SAFETY: as in `close`.
            drop(unsafe { Box::from_raw(self.callback) });
        }
    }
}

/// # Safety
///
/// `string` is null, or a string that lives through the call.
unsafe fn c_string_text(string: *const c_char) -> String {
    if string.is_null() {
        return String::new();
    }
    // SAFETY: by contract.
    unsafe { CStr::from_ptr(string) }.to_string_lossy().into_owned()
}

unsafe extern "C" fn on_cycle<P: ProcessCallback>(frames: u32, arg: *mut c_void) -> c_int {
    // SAFETY: `activate` gave this pointer; only this thread uses what it points to until the client is closed.
    let callback = unsafe { &mut *arg.cast::<CallbackContext<P>>() };
    callback.callback.process(&ProcessCycle {
        api: callback.api,
        ports: &callback.ports,
        frames,
    });
    0
}

/// # Safety
///
/// `arg` is the pointer that `register_callbacks` passed.
unsafe fn server_events<'a>(arg: *mut c_void) -> &'a ServerEvents {
    // SAFETY: by contract; the client, which lives longer than its callbacks, holds it.
    unsafe { &*arg.cast::<ServerEvents>() }
}

unsafe extern "C" fn on_thread_start(arg: *mut c_void) {
    // SAFETY: a callback of `register_callbacks`.
    let events = unsafe { server_events(arg) };
    events.stream_state.set_priority(realtime::priority());
}

unsafe extern "C" fn on_xrun(arg: *mut c_void) -> c_int {
    // SAFETY: a callback of `register_callbacks`.
    unsafe { server_events(arg) }.stream_state.add_xruns(1);
    0
}

unsafe extern "C" fn on_buffer_size(frames: u32, arg: *mut c_void) -> c_int {
    // SAFETY: a callback of `register_callbacks`.
    unsafe { server_events(arg) }.block.store(frames, Ordering::Release);
    0
}

unsafe extern "C" fn on_sample_rate(rate: u32, arg: *mut c_void) -> c_int {
    // SAFETY: a callback of `register_callbacks`.
    unsafe { server_events(arg) }.rate.store(rate, Ordering::Release);
    0
}

unsafe extern "C" fn on_freewheel(is_on: c_int, arg: *mut c_void) {
    // SAFETY: a callback of `register_callbacks`.
    unsafe { server_events(arg) }.stream_state.set_freewheel(is_on != 0);
}

unsafe extern "C" fn on_shutdown(_: c_uint, _: *const c_char, arg: *mut c_void) {
    // SAFETY: a callback of `register_callbacks`.
    unsafe { server_events(arg) }
        .server_ended
        .store(true, Ordering::Release);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_with_retries_of_a_busy_server() {
        let mut attempts = 0;
        let client = open_with_retries(|status| {
            attempts += 1;
            *status = 0x21;
            (attempts == 3).then_some(attempts)
        });
        assert_eq!(client.unwrap(), 3);
    }

    #[test]
    fn open_with_retries_explains_a_refusal() {
        let refusal_text = |status| {
            open_with_retries(|client_status| (None::<()>, *client_status = status).0)
                .unwrap_err()
                .to_string()
        };
        assert!(refusal_text(0x21).contains("too busy"), "{}", refusal_text(0x21));
        assert!(
            refusal_text(0x11).contains("no JACK server runs"),
            "{}",
            refusal_text(0x11)
        );
        assert!(
            refusal_text(0x3).contains("refuses (status 0x3)"),
            "{}",
            refusal_text(0x3)
        );
    }
}
