//! Serial ports and sockets, read without allocation and with a deadline.

use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::time::{Duration, Instant};

use super::{DeviceError, DeviceLoss, DeviceUrl};

/// The connection to a device.
pub(super) enum Port {
    /// A serial line: bytes, in pieces of any size.
    #[cfg(unix)]
    Serial(std::os::fd::OwnedFd),
    #[cfg(not(unix))]
    Serial(Box<dyn serialport::SerialPort>),
    /// Datagrams from and to one address; no other program of this machine sends to it.
    #[cfg(unix)]
    Udp(UdpSocket, #[expect(dead_code)] super::lock::DeviceLock, RefusalFlag),
    #[cfg(not(unix))]
    Udp(UdpSocket, (), RefusalFlag),
    /// A board in this process.
    InProcess(Box<dyn InProcessPort>),
}

/// Whether a datagram was refused because nobody listens at its address, or the device left with an empty datagram.
#[derive(Default)]
pub(super) struct RefusalFlag(bool);

impl RefusalFlag {
    /// Note the error if it is a refusal; other errors are returned.
    fn record_refusal(&mut self, error: std::io::Error) -> std::io::Result<()> {
        if error.kind() == std::io::ErrorKind::ConnectionRefused {
            self.0 = true;
            return Ok(());
        }
        Err(error)
    }
}

/// An emulated board inside this process.
pub(crate) trait InProcessPort: Send {
    /// Send a packet to the board.
    ///
    /// # Errors
    /// [`DeviceLoss`] when there is no board.
    fn write(&mut self, packet: &[u8]) -> Result<(), DeviceLoss>;

    /// Read what the board has sent, without waiting; returns the number of bytes.
    ///
    /// # Errors
    /// [`DeviceLoss`] when there is no board.
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, DeviceLoss>;
}

impl Port {
    pub(super) fn serial(url: &DeviceUrl, baud: u32) -> Result<Self, DeviceError> {
        let builder = serialport::new(url.target.as_str(), baud);
        #[cfg(unix)]
        {
            use std::os::fd::{FromRawFd, IntoRawFd, OwnedFd};
            let tty_port = serialport::TTYPort::open(&builder).map_err(|error| url.open_error(error))?;
            // SAFETY: into_raw_fd gives up the descriptor, which is open.
            let descriptor = unsafe { OwnedFd::from_raw_fd(tty_port.into_raw_fd()) };
            unix::prepare(&descriptor);
            Ok(Self::Serial(descriptor))
        }
        #[cfg(not(unix))]
        {
            let tty_port = builder.timeout(Duration::from_millis(1)).open();
            Ok(Self::Serial(tty_port.map_err(|error| url.closed(error))?))
        }
    }

    /// A socket connected to one address; datagrams from other addresses are ignored.
    pub(super) fn udp(url: &DeviceUrl) -> Result<Self, DeviceError> {
        let open_error = |error: std::io::Error| url.open_error(error);
        let mut addresses = url.target.to_socket_addrs().map_err(open_error)?;
        let peer_address = addresses
            .next()
            .ok_or_else(|| url.open_error("the address cannot be resolved"))?;
        if peer_address.ip().is_multicast()
            || matches!(peer_address, SocketAddr::V4(v4_address) if v4_address.ip().is_broadcast())
        {
            return Err(url.unsupported_error("the address of a device must not be a multicast or broadcast address"));
        }
        let local_address = match (peer_address.ip().is_loopback(), peer_address.is_ipv4()) {
            (true, true) => "127.0.0.1:0",
            (true, false) => "[::1]:0",
            (false, true) => "0.0.0.0:0",
            (false, false) => "[::]:0",
        };
        let udp_socket = UdpSocket::bind(local_address).map_err(open_error)?;
        udp_socket.connect(peer_address).map_err(open_error)?;
        udp_socket.set_nonblocking(true).map_err(open_error)?;
        #[cfg(unix)]
        let device_lock = super::lock::DeviceLock::take(peer_address).map_err(|holder| url.open_error(holder))?;
        #[cfg(not(unix))]
        let device_lock = ();
        Ok(Self::Udp(udp_socket, device_lock, RefusalFlag::default()))
    }

    /// Send a packet; it is dropped if there is no room.
    pub(super) fn write(&mut self, packet: &[u8]) -> Result<(), DeviceLoss> {
        match self {
            #[cfg(unix)]
            Self::Serial(fd) => unix::write(fd, packet),
            #[cfg(not(unix))]
            Self::Serial(port) => std::io::Write::write_all(port, packet).or_else(ignore_transient),
            Self::Udp(socket, _, refusal_flag) => {
                let send_result = socket.send(packet).map(drop);
                send_result
                    .or_else(|error| refusal_flag.record_refusal(error))
                    .or_else(ignore_transient)
            }
            Self::InProcess(board) => board.write(packet),
        }
    }

    /// Read what is there, waiting for something until `deadline`; returns the number of bytes.
    pub(super) fn read(&mut self, buffer: &mut [u8], deadline: Instant) -> Result<usize, DeviceLoss> {
        loop {
            let bytes_read = match self {
                // The board only answers packets, so waiting would not help.
                Self::InProcess(board) => return board.read(buffer),
                #[cfg(unix)]
                Self::Serial(fd) => unix::read(fd, buffer)?,
                #[cfg(not(unix))]
                Self::Serial(port) => std::io::Read::read(port, buffer).or_else(zero_if_transient)?,
                Self::Udp(socket, _, refusal_flag) => {
                    let was_refused = refusal_flag.0;
                    let receive_result = socket.recv(buffer);
                    refusal_flag.0 |= matches!(receive_result, Ok(0)); // an empty datagram: the device leaves
                    let receive_result = receive_result.or_else(|error| refusal_flag.record_refusal(error).map(|()| 0));
                    if refusal_flag.0 && !was_refused {
                        return Ok(0);
                    }
                    receive_result.or_else(zero_if_transient)?
                }
            };
            let time_left = deadline.saturating_duration_since(Instant::now());
            if bytes_read > 0 || time_left.is_zero() {
                return Ok(bytes_read);
            }
            self.wait(time_left)?;
        }
    }

    /// Whether a datagram was refused since the last call.
    pub(super) fn was_refused(&mut self) -> bool {
        match self {
            Self::Udp(_, _, refusal_flag) => std::mem::take(&mut refusal_flag.0),
            _ => false,
        }
    }

    #[cfg(unix)]
    fn wait(&self, timeout: Duration) -> Result<(), DeviceLoss> {
        unix::wait(self.raw_descriptor(), timeout)
    }

    #[cfg(not(unix))]
    #[allow(clippy::unnecessary_wraps)]
    fn wait(&self, timeout: Duration) -> Result<(), DeviceLoss> {
        std::thread::sleep(timeout.min(Duration::from_micros(200)));
        Ok(())
    }

    /// The descriptor that a signal handler may write to.
    #[cfg(unix)]
    pub(super) fn raw_descriptor(&self) -> i32 {
        use std::os::fd::AsRawFd;
        match self {
            Self::Serial(fd) => fd.as_raw_fd(),
            Self::Udp(socket, ..) => socket.as_raw_fd(),
            Self::InProcess(_) => -1,
        }
    }

    #[cfg(not(unix))]
    pub(super) fn raw_descriptor(&self) -> i32 {
        -1
    }
}

fn permanent_loss(error: &std::io::Error) -> Option<DeviceLoss> {
    use std::io::ErrorKind::{ConnectionRefused, Interrupted, TimedOut, WouldBlock};
    match error.kind() {
        // Nobody listens at the address: the device is silent, and may come back.
        WouldBlock | TimedOut | Interrupted | ConnectionRefused => None,
        _ => Some(error.raw_os_error().map_or(DeviceLoss::Closed, DeviceLoss::System)),
    }
}

fn ignore_transient(error: std::io::Error) -> Result<(), DeviceLoss> {
    permanent_loss(&error).map_or(Ok(()), Err)
}

fn zero_if_transient(error: std::io::Error) -> Result<usize, DeviceLoss> {
    permanent_loss(&error).map_or(Ok(0), Err)
}

#[cfg(unix)]
pub(super) mod unix {
    use std::io::Error;
    use std::os::fd::{AsRawFd, OwnedFd};
    use std::time::Duration;

    use super::DeviceLoss;

    /// Make reads non-blocking, and let an FTDI chip pass every byte on at once: by default it waits 16 ms.
    pub(super) fn prepare(fd: &OwnedFd) {
        // SAFETY: the descriptor is open; no pointers are passed.
        unsafe {
            let status_flags = libc::fcntl(fd.as_raw_fd(), libc::F_GETFL);
            libc::fcntl(fd.as_raw_fd(), libc::F_SETFL, status_flags | libc::O_NONBLOCK);
            // The file lock keeps other programs out and ends with this process; exclusive mode would outlive it on a
            // pty.
            libc::ioctl(fd.as_raw_fd(), libc::TIOCNXCL);
        }
        #[cfg(target_os = "linux")]
        set_low_latency(fd);
    }

    /// Ports without this setting (CDC-ACM, pty) refuse it, which does no harm.
    #[cfg(target_os = "linux")]
    fn set_low_latency(fd: &OwnedFd) {
        const ASYNC_LOW_LATENCY: i32 = 1 << 13;
        /// `serial_struct` of linux/serial.h.
        #[repr(C)]
        struct SerialStruct {
            before: [i32; 4],
            flags: i32,
            after: [u64; 16],
        }
        // SAFETY: the kernel reads and writes a serial_struct (72 bytes), for which there is room.
        unsafe {
            let mut serial_settings: SerialStruct = std::mem::zeroed();
            if libc::ioctl(fd.as_raw_fd(), libc::TIOCGSERIAL, &raw mut serial_settings) == 0 {
                serial_settings.flags |= ASYNC_LOW_LATENCY;
                libc::ioctl(fd.as_raw_fd(), libc::TIOCSSERIAL, &raw const serial_settings);
            }
        }
    }

    pub(super) fn write(fd: &OwnedFd, packet: &[u8]) -> Result<(), DeviceLoss> {
        // SAFETY: the descriptor is open and the slice valid. A packet is far shorter than a port's buffer.
        let bytes_written = unsafe { libc::write(fd.as_raw_fd(), packet.as_ptr().cast(), packet.len()) };
        if bytes_written < 0 { last_error() } else { Ok(()) }
    }

    pub(super) fn read(fd: &OwnedFd, buffer: &mut [u8]) -> Result<usize, DeviceLoss> {
        // SAFETY: the descriptor is open and the slice valid.
        let bytes_read = unsafe { libc::read(fd.as_raw_fd(), buffer.as_mut_ptr().cast(), buffer.len()) };
        match usize::try_from(bytes_read) {
            Ok(bytes_read) => Ok(bytes_read),
            Err(_) => last_error().map(|()| 0),
        }
    }

    fn last_error() -> Result<(), DeviceLoss> {
        match Error::last_os_error().raw_os_error() {
            Some(libc::EAGAIN | libc::EINTR) => Ok(()),
            // The errors of a port that was pulled out, or of a pty whose program has ended.
            Some(libc::EIO | libc::ENXIO | libc::ENODEV) => Err(DeviceLoss::Closed),
            error_code => Err(DeviceLoss::System(error_code.unwrap_or(0))),
        }
    }

    /// Wait for something to read.
    pub(super) fn wait(fd: i32, timeout: Duration) -> Result<(), DeviceLoss> {
        let [ready_events] = poll([fd], timeout);
        if ready_events & libc::POLLIN == 0 && ready_events & (libc::POLLHUP | libc::POLLNVAL) != 0 {
            return Err(DeviceLoss::Closed);
        }
        Ok(())
    }

    /// Wait until one of these can be read; returns the events of each.
    pub(in crate::device) fn poll<const N: usize>(fds: [i32; N], timeout: Duration) -> [i16; N] {
        let mut poll_entries = fds.map(|fd| libc::pollfd {
            fd,
            events: libc::POLLIN,
            revents: 0,
        });
        #[cfg(target_os = "linux")]
        // SAFETY: so many pollfds and a timespec, all locals.
        unsafe {
            let timeout = libc::timespec {
                tv_sec: timeout.as_secs().min(3600) as libc::time_t,
                tv_nsec: libc::c_long::from(timeout.subsec_nanos() as i32),
            };
            libc::ppoll(
                poll_entries.as_mut_ptr(),
                N as libc::nfds_t,
                &raw const timeout,
                std::ptr::null(),
            );
        }
        #[cfg(not(target_os = "linux"))]
        // SAFETY: so many pollfds, locals.
        unsafe {
            let timeout = (timeout.as_millis().min(1000) as i32).max(1);
            libc::poll(poll_entries.as_mut_ptr(), N as libc::nfds_t, timeout);
        }
        poll_entries.map(|poll_entry| poll_entry.revents)
    }
}
