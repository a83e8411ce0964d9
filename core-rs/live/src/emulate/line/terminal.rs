//! A pseudo-terminal: the other side is a path that a host opens like a serial port.

use std::ffi::CStr;
use std::io;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::time::Duration;

use super::LineEvent;

pub(in crate::emulate) struct Terminal {
    fd: OwnedFd,
    path: String,
    is_connected: bool,
}

impl Terminal {
    pub(super) fn open() -> io::Result<Self> {
        let mut path_bytes = [0_u8; 128];
        // SAFETY: the calls get valid pointers to locals; both descriptors are owned as soon as they are open.
        let (fd, path) = unsafe {
            let (mut master_fd, mut slave_fd) = (-1, -1);
            let mut raw_termios: libc::termios = std::mem::zeroed();
            libc::cfmakeraw(&raw mut raw_termios);
            let open_status = libc::openpty(
                &raw mut master_fd,
                &raw mut slave_fd,
                path_bytes.as_mut_ptr().cast(),
                (&raw mut raw_termios).cast(),
                std::ptr::null_mut(),
            );
            if open_status != 0 {
                return Err(io::Error::last_os_error());
            }
            // Closed at once, so that a hang-up of the host can be detected.
            drop(OwnedFd::from_raw_fd(slave_fd));
            let fd = OwnedFd::from_raw_fd(master_fd);
            let status_flags = libc::fcntl(fd.as_raw_fd(), libc::F_GETFL);
            libc::fcntl(fd.as_raw_fd(), libc::F_SETFL, status_flags | libc::O_NONBLOCK);
            libc::fcntl(fd.as_raw_fd(), libc::F_SETFD, libc::FD_CLOEXEC);
            (fd, CStr::from_bytes_until_nul(&path_bytes))
        };
        let path = path.map_err(io::Error::other)?.to_string_lossy().into_owned();
        Ok(Self {
            fd,
            path,
            is_connected: false,
        })
    }

    pub(super) fn path(&self) -> &str {
        &self.path
    }

    pub(super) fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<LineEvent> {
        let mut poll_entry = libc::pollfd {
            fd: self.fd.as_raw_fd(),
            events: libc::POLLIN,
            revents: 0,
        };
        wait_for(&mut poll_entry, timeout);
        if poll_entry.revents & libc::POLLIN == 0 {
            if poll_entry.revents & libc::POLLHUP == 0 {
                return Ok(LineEvent::Nothing);
            }
            if std::mem::take(&mut self.is_connected) {
                return Ok(LineEvent::Disconnected);
            }
            // No host has opened it yet: poll then returns at once instead of waiting.
            std::thread::sleep(timeout.min(Duration::from_millis(1)));
            return Ok(LineEvent::Nothing);
        }
        // SAFETY: the descriptor is open and the slice valid.
        let bytes_read = unsafe { libc::read(self.fd.as_raw_fd(), buffer.as_mut_ptr().cast(), buffer.len()) };
        match usize::try_from(bytes_read) {
            Ok(0) => Ok(LineEvent::Nothing),
            Ok(byte_count) => {
                self.is_connected = true;
                Ok(LineEvent::Bytes(byte_count))
            }
            Err(_) => {
                let error = io::Error::last_os_error();
                match error.raw_os_error() {
                    Some(libc::EIO) => Ok(LineEvent::Nothing),
                    _ => super::ignore_transient(error),
                }
            }
        }
    }

    pub(super) fn write(&mut self, bytes: &[u8]) {
        // SAFETY: the descriptor is open and the slice valid. Replies are far shorter than the buffer.
        unsafe { libc::write(self.fd.as_raw_fd(), bytes.as_ptr().cast(), bytes.len()) };
    }
}

#[cfg(target_os = "linux")]
fn wait_for(poll_entry: &mut libc::pollfd, timeout: Duration) {
    let timeout = libc::timespec {
        tv_sec: timeout.as_secs() as libc::time_t,
        tv_nsec: libc::c_long::from(timeout.subsec_nanos() as i32),
    };
    // SAFETY: one pollfd and a timespec, both valid.
    unsafe { libc::ppoll(poll_entry, 1, &raw const timeout, std::ptr::null()) };
}

#[cfg(not(target_os = "linux"))]
fn wait_for(poll_entry: &mut libc::pollfd, timeout: Duration) {
    // SAFETY: one valid pollfd.
    unsafe { libc::poll(poll_entry, 1, (timeout.as_millis() as i32).max(1)) };
}
