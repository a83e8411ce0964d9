//! Opening files under untrusted names: only regular files, and never waiting for the other end of a pipe.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::Path;

/// Open a regular file for reading.
///
/// Opening a pipe would wait for its other end, and a device has no end: `O_NONBLOCK` opens both at once, and the kind
/// of the open file then tells.
pub fn open(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK | libc::O_NOCTTY);
    let opened_file = options.open(path)?;
    let file_metadata = opened_file.metadata()?;
    if file_metadata.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    if !file_metadata.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"));
    }
    Ok(opened_file)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn open_refuses_folders_and_devices() {
        for path in [std::env::temp_dir().as_path(), Path::new("/dev/zero")] {
            assert!(open(path).is_err(), "{}", path.display());
        }
        open(&std::env::current_exe().expect("this program")).expect("is a file");
    }
}
