//! Zero forces when nothing else can run any more: after a panic, a signal or a fault.

#[cfg(not(unix))]
pub(super) use elsewhere::{Armed, arm};
#[cfg(not(unix))]
pub use elsewhere::{block_signals, check_signals, watch, watch_termination};
#[cfg(unix)]
pub(super) use unix::{Armed, arm};
#[cfg(unix)]
pub use unix::{block_signals, check_signals, watch, watch_termination};

/// On a system without file descriptors, the device's own watchdog is the last resort.
#[cfg(not(unix))]
mod elsewhere {
    use crate::safety::contract::ZeroForcePacket;
    use crate::stop::StopScope;

    pub(in crate::safety) struct Armed;

    pub(in crate::safety) fn arm(_: ZeroForcePacket) -> Option<Armed> {
        None
    }

    /// Signals are not watched here.
    pub fn watch(_: i32, _: StopScope) {}

    /// Signals are not watched here.
    pub fn watch_termination() {}

    /// Signals are not watched here.
    pub fn block_signals() {}

    /// Signals are not watched here.
    pub fn check_signals() {}
}

#[cfg(unix)]
mod unix {
    use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU8, AtomicUsize, Ordering};
    use std::sync::{Mutex, Once, OnceLock, PoisonError};

    use super::super::ZERO_REPEATS;
    use crate::safety::contract::ZeroForcePacket;
    use crate::stop::{self, StopScope};

    /// Greatest number of open devices that are zeroed.
    const SLOT_COUNT: usize = 16;
    /// Signals that end a program, but that it may handle and survive.
    const TERMINATION_SIGNALS: [i32; 11] = [
        libc::SIGINT,
        libc::SIGTERM,
        libc::SIGHUP,
        libc::SIGQUIT,
        libc::SIGUSR1,
        libc::SIGUSR2,
        libc::SIGALRM,
        libc::SIGVTALRM,
        libc::SIGPROF,
        libc::SIGXCPU,
        libc::SIGXFSZ,
    ];
    /// Those from SIGUSR1 on mean something else where a program handles them, and end it where it does not: only then
    /// they are watched.
    const OPTIONAL_SIGNALS: &[i32] = TERMINATION_SIGNALS.split_at(4).1;
    /// Signals that a program does not survive; the former handler of each runs after ours.
    const FAULT_SIGNALS: [i32; 7] = [
        libc::SIGABRT,
        libc::SIGSEGV,
        libc::SIGBUS,
        libc::SIGILL,
        libc::SIGFPE,
        libc::SIGSYS,
        libc::SIGTRAP,
    ];

    const FREE_SLOT: i32 = -1;
    const CLAIMED_SLOT: i32 = -2;

    struct Slot {
        fd: AtomicI32,
        len: AtomicUsize,
        bytes: [AtomicU8; 64],
    }

    static ARMED_SLOTS: [Slot; SLOT_COUNT] = [const {
        Slot {
            fd: AtomicI32::new(FREE_SLOT),
            len: AtomicUsize::new(0),
            bytes: [const { AtomicU8::new(0) }; 64],
        }
    }; SLOT_COUNT];

    static FORMER_HANDLERS: [OnceLock<libc::sigaction>; FAULT_SIGNALS.len()] =
        [const { OnceLock::new() }; FAULT_SIGNALS.len()];

    /// A signal that may end the program: what it stops, and the handler that was set before ours.
    struct WatchedSignal {
        scope: AtomicU8,
        /// Whether our handler was set.
        is_watched: AtomicBool,
        handler: AtomicUsize,
        has_info: AtomicBool,
    }

    static WATCHED_SIGNALS: [WatchedSignal; TERMINATION_SIGNALS.len()] = [const {
        WatchedSignal {
            scope: AtomicU8::new(StopScope::All as u8),
            is_watched: AtomicBool::new(false),
            handler: AtomicUsize::new(libc::SIG_DFL),
            has_info: AtomicBool::new(false),
        }
    }; TERMINATION_SIGNALS.len()];

    /// A device that is zeroed in an emergency, as long as this value lives.
    pub(in crate::safety) struct Armed(usize);

    impl Drop for Armed {
        fn drop(&mut self) {
            ARMED_SLOTS[self.0].fd.store(FREE_SLOT, Ordering::Release);
        }
    }

    /// Register a device to be zeroed when the program panics or is ended.
    pub(in crate::safety) fn arm(packet: ZeroForcePacket) -> Option<Armed> {
        static HOOKS: Once = Once::new();
        HOOKS.call_once(|| {
            let former_hook = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |info| {
                zero_all();
                former_hook(info);
            }));
            for (signal, former_handler) in FAULT_SIGNALS.into_iter().zip(&FORMER_HANDLERS) {
                watch_fault(signal, former_handler);
            }
        });
        watch_termination();
        let claim_slot = |slot: &Slot| {
            let claim_result = slot
                .fd
                .compare_exchange(FREE_SLOT, CLAIMED_SLOT, Ordering::AcqRel, Ordering::Relaxed);
            claim_result.is_ok()
        };
        let slot_index = ARMED_SLOTS.iter().position(claim_slot)?;
        let slot = &ARMED_SLOTS[slot_index];
        for (slot_byte, packet_byte) in slot.bytes.iter().zip(packet.bytes) {
            slot_byte.store(packet_byte, Ordering::Relaxed);
        }
        slot.len.store(packet.len, Ordering::Relaxed);
        slot.fd.store(packet.fd, Ordering::Release);
        Some(Armed(slot_index))
    }

    /// Send all packets of zero forces. It does only what a signal handler may do: loads, write(2) and nanosleep(2).
    fn zero_all() {
        for repeat in 0..ZERO_REPEATS {
            if repeat > 0 {
                // By then a force that another thread was just sending has gone out.
                let wait_time = libc::timespec {
                    tv_sec: 0,
                    tv_nsec: 1_000_000,
                };
                // SAFETY: a valid timespec; the remaining time is not requested.
                unsafe { libc::nanosleep(&raw const wait_time, std::ptr::null_mut()) };
            }
            for slot in &ARMED_SLOTS {
                let device_fd = slot.fd.load(Ordering::Acquire);
                if device_fd < 0 {
                    continue;
                }
                let mut bytes = [0_u8; 64];
                for (packet_byte, slot_byte) in bytes.iter_mut().zip(&slot.bytes) {
                    *packet_byte = slot_byte.load(Ordering::Relaxed);
                }
                let len = slot.len.load(Ordering::Relaxed).min(bytes.len());
                // SAFETY: `bytes` holds `len` bytes; a descriptor closed meanwhile makes the call fail.
                unsafe { libc::write(device_fd, bytes.as_ptr().cast(), len) };
            }
        }
    }

    /// Address of this thread's errno.
    fn errno() -> *mut i32 {
        #[cfg(target_os = "linux")]
        // SAFETY: the call has no preconditions.
        unsafe {
            libc::__errno_location()
        }
        #[cfg(target_os = "macos")]
        // SAFETY: the call has no preconditions.
        unsafe {
            libc::__error()
        }
        #[cfg(not(any(target_os = "linux", target_os = "macos")))]
        std::ptr::null_mut()
    }

    extern "C" fn on_fault(signal: i32) {
        stop::stop(StopScope::All);
        zero_all();
        let fault_index = FAULT_SIGNALS.iter().position(|&known| known == signal);
        if let Some(former_action) = fault_index.and_then(|index| FORMER_HANDLERS[index].get()) {
            // The signal is raised again, and the former handler gets it when this one returns.
            // SAFETY: `former_action` is what sigaction gave; both calls are allowed in a handler.
            unsafe {
                libc::sigaction(signal, former_action, std::ptr::null_mut());
                libc::raise(signal);
            }
        }
    }

    /// Stop what the signal stops, then call the former handler: Python's only notes the signal, and acts when the
    /// interpreter runs.
    extern "C" fn on_termination(signal: i32, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
        let Some(signal_index) = TERMINATION_SIGNALS.iter().position(|&known| known == signal) else {
            return;
        };
        let watched = &WATCHED_SIGNALS[signal_index];
        let stop_scope = StopScope::from_bits(watched.scope.load(Ordering::SeqCst));
        if stop_scope != StopScope::Nothing {
            let errno = errno();
            // SAFETY: not null, and owned by this thread. The interrupted code must find errno unchanged.
            let errno_before = (!errno.is_null()).then(|| unsafe { *errno });
            stop::stop(stop_scope);
            zero_all();
            if let Some(saved_errno) = errno_before {
                // SAFETY: as above.
                unsafe { *errno = saved_errno };
            }
        }
        let handler = watched.handler.load(Ordering::SeqCst);
        match handler {
            libc::SIG_IGN => {}
            libc::SIG_DFL => {
                // SAFETY: zero is the default action; both calls are allowed in a handler.
                unsafe {
                    let default_action: libc::sigaction = std::mem::zeroed();
                    libc::sigaction(signal, &raw const default_action, std::ptr::null_mut());
                    libc::raise(signal);
                }
            }
            _ if watched.has_info.load(Ordering::SeqCst) => {
                type InfoHandler = extern "C" fn(i32, *mut libc::siginfo_t, *mut libc::c_void);
                // SAFETY: sigaction gave this address for a handler of three arguments.
                let handler = unsafe { std::mem::transmute::<usize, InfoHandler>(handler) };
                handler(signal, info, context);
            }
            _ => {
                // SAFETY: sigaction gave this address for a handler of one argument.
                let handler = unsafe { std::mem::transmute::<usize, extern "C" fn(i32)>(handler) };
                handler(signal);
            }
        }
    }

    /// Set what a signal stops before its handler runs, until somebody else sets another handler.
    ///
    /// Signals that do not end programs, and ignored signals, are left alone.
    pub fn watch(signal: i32, scope: StopScope) {
        if let Some(signal_index) = TERMINATION_SIGNALS.iter().position(|&known| known == signal) {
            WATCHED_SIGNALS[signal_index].scope.store(scope as u8, Ordering::SeqCst);
            watch_termination_signal(signal);
        }
    }

    fn termination_set() -> libc::sigset_t {
        // SAFETY: the calls fill the local set.
        unsafe {
            let mut signal_set: libc::sigset_t = std::mem::zeroed();
            libc::sigemptyset(&raw mut signal_set);
            for signal in TERMINATION_SIGNALS {
                libc::sigaddset(&raw mut signal_set, signal);
            }
            signal_set
        }
    }

    /// Block signals that end programs in this thread: other threads handle them, and this one can check for pending
    /// ones.
    pub fn block_signals() {
        let signal_set = termination_set();
        // SAFETY: the set is valid; the former mask is not requested.
        unsafe { libc::pthread_sigmask(libc::SIG_BLOCK, &raw const signal_set, std::ptr::null_mut()) };
    }

    /// Stop what a pending signal stops: the thread that is to handle it may be waiting for a processor, or handle no
    /// signals for a while. For a thread that called [`block_signals`].
    pub fn check_signals() {
        // SAFETY: the calls fill a local set and read it.
        unsafe {
            let mut signal_set: libc::sigset_t = std::mem::zeroed();
            if libc::sigpending(&raw mut signal_set) != 0 {
                return;
            }
            for (signal, watched) in TERMINATION_SIGNALS.into_iter().zip(&WATCHED_SIGNALS) {
                let ends_program = !OPTIONAL_SIGNALS.contains(&signal) || watched.is_watched.load(Ordering::SeqCst);
                if ends_program && libc::sigismember(&raw const signal_set, signal) == 1 {
                    stop::stop(StopScope::from_bits(watched.scope.load(Ordering::SeqCst)));
                }
            }
        }
    }

    /// Watch every signal that ends programs; by default it stops everything.
    pub fn watch_termination() {
        TERMINATION_SIGNALS.into_iter().for_each(watch_termination_signal);
    }

    /// Install our handler in front of the present one.
    fn watch_termination_signal(signal: i32) {
        static INSTALLATION: Mutex<()> = Mutex::new(());
        let _guard = INSTALLATION.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(signal_index) = TERMINATION_SIGNALS.iter().position(|&known| known == signal) else {
            return;
        };
        // SAFETY: zero is a valid sigaction, the calls write into locals, the handler does only what handlers may.
        unsafe {
            let mut former_action: libc::sigaction = std::mem::zeroed();
            libc::sigaction(signal, std::ptr::null(), &raw mut former_action);
            let handler_address = on_termination as *const () as usize;
            if [handler_address, libc::SIG_IGN].contains(&former_action.sa_sigaction) {
                return;
            }
            if OPTIONAL_SIGNALS.contains(&signal) && former_action.sa_sigaction != libc::SIG_DFL {
                return;
            }
            let watched = &WATCHED_SIGNALS[signal_index];
            watched.is_watched.store(true, Ordering::SeqCst);
            watched
                .has_info
                .store(former_action.sa_flags & libc::SA_SIGINFO != 0, Ordering::SeqCst);
            watched.handler.store(former_action.sa_sigaction, Ordering::SeqCst);
            let mut new_action = former_action;
            new_action.sa_sigaction = handler_address;
            // Whether interrupted system calls restart is decided by the flags of the former handler.
            new_action.sa_flags = former_action.sa_flags & libc::SA_RESTART | libc::SA_ONSTACK | libc::SA_SIGINFO;
            libc::sigaction(signal, &raw const new_action, std::ptr::null_mut());
        }
    }

    fn watch_fault(signal: i32, former_slot: &OnceLock<libc::sigaction>) {
        // SAFETY: zero is a valid sigaction, the calls write into locals, the handler does only what handlers may.
        unsafe {
            let mut former_action: libc::sigaction = std::mem::zeroed();
            libc::sigaction(signal, std::ptr::null(), &raw mut former_action);
            if former_action.sa_sigaction == libc::SIG_IGN {
                return;
            }
            let _ = former_slot.set(former_action);
            let mut new_action: libc::sigaction = std::mem::zeroed();
            new_action.sa_sigaction = on_fault as *const () as usize;
            libc::sigemptyset(&raw mut new_action.sa_mask);
            new_action.sa_flags = libc::SA_ONSTACK;
            libc::sigaction(signal, &raw const new_action, std::ptr::null_mut());
        }
    }
}
