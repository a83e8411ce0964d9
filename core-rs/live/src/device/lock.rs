//! Only one program of this machine at a time can have a device: a lock on a file that is named after the address.
//!
//! Serial ports have such a lock themselves. Any program may send datagrams, so a board on UDP has a lock file in the
//! user's run-time folder. The system releases the lock when the program ends, however it ends.

use std::fs::{DirBuilder, File, OpenOptions, Permissions, TryLockError};
use std::io::{ErrorKind, Read, Write};
use std::net::SocketAddr;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// A device that this program has locked, until this is dropped.
#[derive(Debug)]
pub(super) struct DeviceLock {
    _lock_file: Option<File>,
}

impl DeviceLock {
    /// Lock the board at an address. If there is no folder for the file, there is no check for other programs, and the
    /// call succeeds.
    ///
    /// # Errors
    /// A sentence on who has the board.
    pub(super) fn take(address: SocketAddr) -> Result<Self, String> {
        let folder = folder();
        match &folder {
            Some(folder) => Self::lock_in(folder, address),
            None => Ok(Self { _lock_file: None }),
        }
    }

    fn lock_in(folder: &Path, address: SocketAddr) -> Result<Self, String> {
        let lock_path = folder.join(format!(
            "board-{}.lock",
            address.to_string().replace([':', '[', ']', '%'], "_")
        ));
        let open_result = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .custom_flags(libc::O_NOFOLLOW)
            .open(&lock_path);
        let Ok(mut lock_file) = open_result else {
            return Ok(Self { _lock_file: None });
        };
        match lock_file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(holder_sentence(&lock_file)),
            Err(TryLockError::Error(_)) => return Ok(Self { _lock_file: None }),
        }
        let _ = lock_file.set_len(0);
        let _ = write!(lock_file, "{}", std::process::id());
        Ok(Self {
            _lock_file: Some(lock_file),
        })
    }
}

/// Why a board cannot be locked: the holder of the lock writes its process number into the file.
fn holder_sentence(file: &File) -> String {
    let mut holder_text = String::new();
    let _ = file.take(64).read_to_string(&mut holder_text);
    match holder_text.trim().parse::<u32>() {
        Ok(process) if process == std::process::id() => "this program has the device open already".into(),
        Ok(process) => {
            format!("process {process} has the device open; only one program at a time can use it")
        }
        Err(_) => "another program has the device open; only one at a time can use it".into(),
    }
}

/// The user's run-time folder, created if it is missing; `None` if no folder belongs to this user alone.
fn folder() -> Option<PathBuf> {
    // SAFETY: geteuid has no arguments and cannot fail.
    let user_id = unsafe { libc::geteuid() };
    let lock_folder = match std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from) {
        Some(folder) if folder.is_dir() => folder.join("ergon"),
        _ => std::env::temp_dir().join(format!("ergon-{user_id}")),
    };
    match DirBuilder::new().mode(0o700).create(&lock_folder) {
        // A umask can take the owner's rights too.
        Ok(()) => std::fs::set_permissions(&lock_folder, Permissions::from_mode(0o700)).ok()?,
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        Err(_) => return None,
    }
    is_own_folder(&lock_folder, user_id).then_some(lock_folder)
}

/// Whether a path is a folder that this user alone may open, and not a link: any user can create a file of that name
/// in /tmp.
fn is_own_folder(path: &Path, user: u32) -> bool {
    std::fs::symlink_metadata(path)
        .is_ok_and(|metadata| metadata.is_dir() && metadata.uid() == user && metadata.mode() & 0o077 == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn device_lock_is_exclusive_until_dropped() {
        let lock_folder = std::env::temp_dir().join(format!("ergon-lock-{}", std::process::id()));
        std::fs::create_dir_all(&lock_folder).unwrap();
        let [address, other_address] = [9801, 9802].map(|port| SocketAddr::from(([192, 168, 1, 20], port)));
        let first_lock = DeviceLock::lock_in(&lock_folder, address).unwrap();
        assert_eq!(
            DeviceLock::lock_in(&lock_folder, address).unwrap_err(),
            "this program has the device open already"
        );
        DeviceLock::lock_in(&lock_folder, other_address).unwrap();
        drop(first_lock);
        DeviceLock::lock_in(&lock_folder, address).unwrap();
        std::fs::remove_dir_all(&lock_folder).unwrap();
        DeviceLock::lock_in(&lock_folder, address).unwrap();
    }

    #[test]
    fn lock_folder_by_owner_mode_and_link() {
        let base_folder = std::env::temp_dir().join(format!("ergon-own-{}", std::process::id()));
        std::fs::create_dir_all(&base_folder).unwrap();
        let (plain_file, folder_link) = (base_folder.join("file"), base_folder.join("link"));
        std::fs::write(&plain_file, "").unwrap();
        std::os::unix::fs::symlink(&base_folder, &folder_link).unwrap();
        let user_id = std::fs::metadata(&base_folder).unwrap().uid();
        let set_mode = |mode| std::fs::set_permissions(&base_folder, Permissions::from_mode(mode)).unwrap();
        set_mode(0o700);
        assert!(is_own_folder(&base_folder, user_id));
        set_mode(0o720);
        assert!(!is_own_folder(&base_folder, user_id));
        set_mode(0o700);
        assert!(!is_own_folder(&base_folder, user_id + 1));
        assert!(!is_own_folder(&plain_file, user_id));
        assert!(!is_own_folder(&folder_link, user_id));
        std::fs::remove_dir_all(&base_folder).unwrap();
    }
}
