//! One program of this machine at a time has a device: a lock on a file that is called after its address.
//!
//! Serial ports have such a lock themselves. A datagram may be sent by anybody, so a board in datagrams has its file in
//! the user's run-time folder. The system lets go of the lock when the program ends, however it ends.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::net::SocketAddr;
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// A device that this program has; it is another's once this is dropped.
#[derive(Debug)]
pub(super) struct Owned {
    _locked: Option<File>,
}

impl Owned {
    /// Take the board at an address. Where there is no folder for the file, nothing is known of others, and it is taken.
    ///
    /// # Errors
    /// Who has it.
    pub(super) fn take(address: SocketAddr) -> Result<Self, String> {
        let folder = folder();
        match &folder {
            Some(folder) => Self::within(folder, address),
            None => Ok(Self { _locked: None }),
        }
    }

    fn within(folder: &Path, address: SocketAddr) -> Result<Self, String> {
        let path = folder.join(format!(
            "board-{}.lock",
            address.to_string().replace([':', '[', ']', '%'], "_")
        ));
        let opened = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .custom_flags(libc::O_NOFOLLOW | libc::O_CLOEXEC)
            .open(&path);
        let Ok(mut file) = opened else {
            return Ok(Self { _locked: None });
        };
        // SAFETY: the descriptor is open; no pointers are passed.
        if unsafe { libc::flock(file.as_raw_fd(), libc::LOCK_EX | libc::LOCK_NB) } != 0 {
            if std::io::Error::last_os_error().kind() != ErrorKind::WouldBlock {
                return Ok(Self { _locked: None });
            }
            let mut who = String::new();
            let _ = (&mut file).take(64).read_to_string(&mut who);
            let who = who.trim();
            return Err(match who.parse::<u32>() {
                Ok(process) if process == std::process::id() => {
                    "this program has it open already".into()
                }
                Ok(process) => {
                    format!("process {process} has it open; one program at a time plays a board")
                }
                Err(_) => "another program has it open; one at a time plays a board".into(),
            });
        }
        let _ = file.set_len(0);
        let _ = write!(file, "{}", std::process::id());
        Ok(Self {
            _locked: Some(file),
        })
    }
}

/// The user's folder of what runs, made if need be.
fn folder() -> Option<PathBuf> {
    let folder = match std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from) {
        Some(own) if own.is_dir() => own.join("ergon"),
        // SAFETY: getuid has no arguments and cannot fail.
        _ => std::env::temp_dir().join(format!("ergon-{}", unsafe { libc::getuid() })),
    };
    match DirBuilder::new().mode(0o700).create(&folder) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => None,
        _ => Some(folder),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_has_one_owner_until_that_lets_go() {
        let folder = std::env::temp_dir().join(format!("ergon-owner-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let [one, other] = [9801, 9802].map(|port| SocketAddr::from(([192, 168, 1, 20], port)));
        let first = Owned::within(&folder, one).unwrap();
        assert_eq!(
            Owned::within(&folder, one).unwrap_err(),
            "this program has it open already"
        );
        Owned::within(&folder, other).unwrap();
        drop(first);
        Owned::within(&folder, one).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        Owned::within(&folder, one).unwrap();
    }
}
