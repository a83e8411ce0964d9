//! Zero forces from where nothing else can run: a panic, a signal, a fault.

#[cfg(not(unix))]
pub(super) use elsewhere::{Armed, arm, is_over};
#[cfg(unix)]
pub(super) use unix::{Armed, arm, is_over};

/// Where there are no file descriptors, a device's own watchdog is the last resort.
#[cfg(not(unix))]
mod elsewhere {
    use crate::device::LastResort;

    pub(in crate::safety) struct Armed;

    pub(in crate::safety) fn arm(_: LastResort) -> Option<Armed> {
        None
    }

    pub(in crate::safety) fn is_over() -> bool {
        false
    }
}

#[cfg(unix)]
mod unix {
    use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU8, AtomicUsize, Ordering};
    use std::sync::{Once, OnceLock};

    use super::super::FAREWELLS;
    use crate::device::LastResort;

    /// Devices open at once, at most, that are zeroed.
    const SLOTS: usize = 16;
    /// Ends of a program that it may survive.
    const ENDS: [i32; 4] = [libc::SIGINT, libc::SIGTERM, libc::SIGHUP, libc::SIGQUIT];
    /// Those, and faults. What each did before it does after us.
    const SIGNALS: [i32; 9] = [
        libc::SIGINT,
        libc::SIGTERM,
        libc::SIGHUP,
        libc::SIGQUIT,
        libc::SIGABRT,
        libc::SIGSEGV,
        libc::SIGBUS,
        libc::SIGILL,
        libc::SIGFPE,
    ];

    const FREE: i32 = -1;
    const TAKEN: i32 = -2;

    struct Slot {
        fd: AtomicI32,
        len: AtomicUsize,
        bytes: [AtomicU8; 64],
    }

    static ARMED: [Slot; SLOTS] = [const {
        Slot {
            fd: AtomicI32::new(FREE),
            len: AtomicUsize::new(0),
            bytes: [const { AtomicU8::new(0) }; 64],
        }
    }; SLOTS];

    static BEFORE: [OnceLock<libc::sigaction>; SIGNALS.len()] =
        [const { OnceLock::new() }; SIGNALS.len()];

    /// Set while a signal is handled: its handler runs in any thread, and another may be about to send a force.
    static OVER: AtomicBool = AtomicBool::new(false);

    /// Whether the program is being ended, and nothing but zero may be sent.
    pub(in crate::safety) fn is_over() -> bool {
        OVER.load(Ordering::SeqCst)
    }

    /// A device that is zeroed, as long as this lives.
    pub(in crate::safety) struct Armed(usize);

    impl Drop for Armed {
        fn drop(&mut self) {
            ARMED[self.0].fd.store(FREE, Ordering::Release);
        }
    }

    /// Have a device zeroed when the program panics or is ended.
    pub(in crate::safety) fn arm(resort: LastResort) -> Option<Armed> {
        static HOOKS: Once = Once::new();
        HOOKS.call_once(|| {
            let before = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |info| {
                zero_all();
                before(info);
            }));
            for (signal, before) in SIGNALS.into_iter().zip(&BEFORE) {
                watch(signal, before);
            }
        });
        let claim = |slot: &Slot| {
            let taken = slot
                .fd
                .compare_exchange(FREE, TAKEN, Ordering::AcqRel, Ordering::Relaxed);
            taken.is_ok()
        };
        let index = ARMED.iter().position(claim)?;
        let slot = &ARMED[index];
        for (to, from) in slot.bytes.iter().zip(resort.bytes) {
            to.store(from, Ordering::Relaxed);
        }
        slot.len.store(resort.len, Ordering::Relaxed);
        slot.fd.store(resort.fd, Ordering::Release);
        Some(Armed(index))
    }

    /// Only what a signal handler may do: loads, write(2) and nanosleep(2).
    fn zero_all() {
        for farewell in 0..FAREWELLS {
            if farewell > 0 {
                // A force that was already on its way in another thread has passed by then.
                let while_it_passes = libc::timespec {
                    tv_sec: 0,
                    tv_nsec: 1_000_000,
                };
                // SAFETY: a valid timespec; what is left is not asked for.
                unsafe { libc::nanosleep(&raw const while_it_passes, std::ptr::null_mut()) };
            }
            for slot in &ARMED {
                let fd = slot.fd.load(Ordering::Acquire);
                if fd < 0 {
                    continue;
                }
                let mut bytes = [0_u8; 64];
                for (to, from) in bytes.iter_mut().zip(&slot.bytes) {
                    *to = from.load(Ordering::Relaxed);
                }
                let len = slot.len.load(Ordering::Relaxed).min(bytes.len());
                // SAFETY: `bytes` holds `len` bytes; a descriptor closed meanwhile makes the call fail.
                unsafe { libc::write(fd, bytes.as_ptr().cast(), len) };
            }
        }
    }

    /// Where this thread keeps the number of its last error.
    fn errno() -> *mut i32 {
        #[cfg(target_os = "linux")]
        // SAFETY: it has no conditions.
        unsafe {
            libc::__errno_location()
        }
        #[cfg(target_os = "macos")]
        // SAFETY: it has no conditions.
        unsafe {
            libc::__error()
        }
        #[cfg(not(any(target_os = "linux", target_os = "macos")))]
        std::ptr::null_mut()
    }

    extern "C" fn on_signal(signal: i32) {
        let errno = errno();
        // SAFETY: not null, it is this thread's own. What was interrupted must find it as it was.
        let before = (!errno.is_null()).then(|| unsafe { *errno });
        OVER.store(true, Ordering::SeqCst);
        zero_all();
        if let Some(number) = before {
            // SAFETY: as above.
            unsafe { *errno = number };
        }
        let known = SIGNALS.iter().position(|&known| known == signal);
        if let Some(before) = known.and_then(|index| BEFORE[index].get()) {
            // Where somebody else handles it (Python's Ctrl-C), the program goes on and may push again. No fault does.
            let is_fault = !ENDS.contains(&signal);
            let is_handled =
                !is_fault && ![libc::SIG_DFL, libc::SIG_IGN].contains(&before.sa_sigaction);
            OVER.store(!is_handled, Ordering::SeqCst);
            // A fault happens again when we return, another signal is raised again: then the former handler has it.
            // SAFETY: `before` is what sigaction gave; both calls are allowed in a handler.
            unsafe {
                libc::sigaction(signal, before, std::ptr::null_mut());
                libc::raise(signal);
            }
        }
    }

    fn watch(signal: i32, before: &OnceLock<libc::sigaction>) {
        // SAFETY: zero is a valid sigaction, the calls write into locals, the handler does only what handlers may.
        unsafe {
            let mut old: libc::sigaction = std::mem::zeroed();
            libc::sigaction(signal, std::ptr::null(), &raw mut old);
            if old.sa_sigaction == libc::SIG_IGN {
                return;
            }
            let _ = before.set(old);
            let mut new: libc::sigaction = std::mem::zeroed();
            new.sa_sigaction = on_signal as *const () as usize;
            libc::sigemptyset(&raw mut new.sa_mask);
            new.sa_flags = libc::SA_ONSTACK;
            libc::sigaction(signal, &raw const new, std::ptr::null_mut());
        }
    }
}
