//! libjack, loaded when it is first needed: the program is not linked to it, and also runs where there is no JACK.

use std::ffi::{c_char, c_int, c_uint, c_ulong, c_void};
use std::sync::OnceLock;

use libloading::Library;

use crate::audio::AudioError;

#[cfg(target_os = "macos")]
const LIBRARY_NAMES: [&str; 2] = ["libjack.0.dylib", "/usr/local/lib/libjack.0.dylib"];
#[cfg(windows)]
const LIBRARY_NAMES: [&str; 1] = ["libjack64.dll"];
#[cfg(not(any(target_os = "macos", windows)))]
const LIBRARY_NAMES: [&str; 1] = ["libjack.so.0"];

/// `jack_client_t`.
#[repr(C)]
pub(super) struct RawClient {
    _opaque: [u8; 0],
}

/// `jack_port_t`.
#[repr(C)]
pub(super) struct RawPort {
    _opaque: [u8; 0],
}

/// `jack_latency_range_t`.
#[repr(C)]
#[derive(Default)]
pub(super) struct LatencyRange {
    pub(super) min: u32,
    pub(super) max: u32,
}

pub(super) const NO_START_SERVER: c_uint = 1;
pub(super) const SERVER_FAILED: c_uint = 0x10;
pub(super) const SERVER_ERROR: c_uint = 0x20;
pub(super) const PORT_IS_INPUT: c_ulong = 1;
pub(super) const PORT_IS_OUTPUT: c_ulong = 2;
pub(super) const PORT_IS_PHYSICAL: c_ulong = 4;
pub(super) const CAPTURE_LATENCY: c_uint = 0;
pub(super) const PLAYBACK_LATENCY: c_uint = 1;
pub(super) const AUDIO_PORT_TYPE: &std::ffi::CStr = c"32 bit float mono audio";

pub(super) type FrameCountCallback = unsafe extern "C" fn(u32, *mut c_void) -> c_int;
pub(super) type EventCallback = unsafe extern "C" fn(*mut c_void) -> c_int;
pub(super) type SwitchCallback = unsafe extern "C" fn(c_int, *mut c_void);
pub(super) type ThreadCallback = unsafe extern "C" fn(*mut c_void);
pub(super) type ShutdownCallback = unsafe extern "C" fn(c_uint, *const c_char, *mut c_void);
type MessageCallback = unsafe extern "C" fn(*const c_char);

macro_rules! api {
    ($($name:ident = $symbol:literal: $kind:ty;)*) => {
        /// The functions of libjack in use, by their names without `jack_`.
        pub(super) struct Api {
            $(pub(super) $name: $kind,)*
            _library: Library,
        }

        impl Api {
            fn load(library: Library) -> Result<Self, libloading::Error> {
                // SAFETY: the types are those of jack/jack.h and its neighbours.
                unsafe {
                    Ok(Self {
                        $($name: *library.get::<$kind>(concat!($symbol, "\0"))?,)*
                        _library: library,
                    })
                }
            }
        }
    };
}

api! {
    client_open = "jack_client_open":
        unsafe extern "C" fn(*const c_char, c_uint, *mut c_uint, ...) -> *mut RawClient;
    client_close = "jack_client_close": unsafe extern "C" fn(*mut RawClient) -> c_int;
    get_client_name = "jack_get_client_name": unsafe extern "C" fn(*mut RawClient) -> *const c_char;
    activate = "jack_activate": unsafe extern "C" fn(*mut RawClient) -> c_int;
    deactivate = "jack_deactivate": unsafe extern "C" fn(*mut RawClient) -> c_int;
    get_sample_rate = "jack_get_sample_rate": unsafe extern "C" fn(*mut RawClient) -> u32;
    get_buffer_size = "jack_get_buffer_size": unsafe extern "C" fn(*mut RawClient) -> u32;
    set_freewheel = "jack_set_freewheel": unsafe extern "C" fn(*mut RawClient, c_int) -> c_int;
    on_process = "jack_set_process_callback":
        unsafe extern "C" fn(*mut RawClient, FrameCountCallback, *mut c_void) -> c_int;
    on_thread = "jack_set_thread_init_callback":
        unsafe extern "C" fn(*mut RawClient, ThreadCallback, *mut c_void) -> c_int;
    on_xrun = "jack_set_xrun_callback":
        unsafe extern "C" fn(*mut RawClient, EventCallback, *mut c_void) -> c_int;
    on_buffer_size = "jack_set_buffer_size_callback":
        unsafe extern "C" fn(*mut RawClient, FrameCountCallback, *mut c_void) -> c_int;
    on_sample_rate = "jack_set_sample_rate_callback":
        unsafe extern "C" fn(*mut RawClient, FrameCountCallback, *mut c_void) -> c_int;
    on_freewheel = "jack_set_freewheel_callback":
        unsafe extern "C" fn(*mut RawClient, SwitchCallback, *mut c_void) -> c_int;
    on_shutdown = "jack_on_info_shutdown":
        unsafe extern "C" fn(*mut RawClient, ShutdownCallback, *mut c_void);
    port_register = "jack_port_register": unsafe extern "C" fn(
        *mut RawClient, *const c_char, *const c_char, c_ulong, c_ulong) -> *mut RawPort;
    port_name = "jack_port_name": unsafe extern "C" fn(*const RawPort) -> *const c_char;
    port_get_buffer = "jack_port_get_buffer":
        unsafe extern "C" fn(*mut RawPort, u32) -> *mut c_void;
    port_get_latency_range = "jack_port_get_latency_range":
        unsafe extern "C" fn(*mut RawPort, c_uint, *mut LatencyRange);
    get_ports = "jack_get_ports": unsafe extern "C" fn(
        *mut RawClient, *const c_char, *const c_char, c_ulong) -> *mut *const c_char;
    connect = "jack_connect":
        unsafe extern "C" fn(*mut RawClient, *const c_char, *const c_char) -> c_int;
    free = "jack_free": unsafe extern "C" fn(*mut c_void);
    set_error_function = "jack_set_error_function": unsafe extern "C" fn(MessageCallback);
    set_info_function = "jack_set_info_function": unsafe extern "C" fn(MessageCallback);
}

unsafe extern "C" fn ignore_message(_: *const c_char) {}

/// The library, if it is installed.
pub(super) fn api() -> Result<&'static Api, AudioError> {
    static API: OnceLock<Result<Api, String>> = OnceLock::new();
    let load_result = API.get_or_init(|| {
        let mut load_error = String::new();
        for name in LIBRARY_NAMES {
            // SAFETY: libjack's initialisers do nothing that this program would not bear.
            match unsafe { Library::new(name) }.and_then(Api::load) {
                Ok(api) => {
                    // A missing server is reported by our own message, not by libjack on the terminal.
                    // SAFETY: the function lives as long as the program.
                    unsafe {
                        (api.set_error_function)(ignore_message);
                        (api.set_info_function)(ignore_message);
                    }
                    return Ok(api);
                }
                Err(error) => load_error = error.to_string(),
            }
        }
        Err(load_error)
    });
    load_result.as_ref().map_err(|load_error| AudioError::Unavailable {
        backend: "jack",
        reason: format!("there is no JACK library ({load_error}): install jackd2 or pipewire-jack"),
    })
}
