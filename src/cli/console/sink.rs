//! Output files. `-` is stdout. Follows symbolic links, and writes straight to devices and FIFOs. When a full disk cuts
//! a file off, whole rows remain. It is an error if another program deletes or truncates the file meanwhile.

use std::ffi::OsString;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use crate::cli::console::interrupt::Interrupt;
use crate::cli::console::note::note;
use crate::cli::context::Failure;

/// The most symbolic links to follow, as in the kernel.
const LINKS: usize = 40;
/// Rows are buffered up to this many bytes.
const COLLECTED: usize = 1 << 13;
/// A writable pipe takes this many bytes without blocking (PIPE_BUF).
const PIECE: usize = 4096;
/// Period at which a blocked write checks for a signal.
const LOOK_MS: u16 = 50;
/// How long a reader has after a signal to read the rest.
const LAST: Duration = Duration::from_secs(1);

/// Whether `path` means stdout.
pub fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

/// Another program's deed to a file while this program wrote it.
#[derive(Debug, Clone, Copy, thiserror::Error)]
enum Taken {
    #[error(
        "another program deleted it while this one wrote it: the rows that it had are gone, and no more are written"
    )]
    Deleted,
    #[error("another program truncated it while this one wrote it: rows are gone, and no more are written")]
    Truncated,
}

/// Whether `error` says that another program has deleted or truncated the file.
pub fn is_taken(error: &io::Error) -> bool {
    error.get_ref().is_some_and(|inner| inner.is::<Taken>())
}

/// The failure for an error in writing to `path`. A closed pipe is not a failure ([`crate::cli::run`]).
fn failed(path: &Path, error: io::Error) -> Failure {
    match error.kind() {
        io::ErrorKind::BrokenPipe => Failure::Output(error),
        _ if is_taken(&error) => Failure::Refused(format!("{}: {error}", path.display())),
        _ => Failure::Request(format!("{}: {error}", path.display())),
    }
}

/// The target of `path` behind symbolic links, and its metadata if it exists.
fn followed(path: &Path) -> io::Result<(PathBuf, Option<Metadata>)> {
    let there = match fs::metadata(path) {
        Ok(there) => Some(there),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(error),
    };
    let mut target = path.to_owned();
    for _ in 0..LINKS {
        match fs::symlink_metadata(&target) {
            Ok(link) if link.is_symlink() => {
                let to = fs::read_link(&target)?;
                target = target.parent().unwrap_or(Path::new("")).join(to);
            }
            _ => return Ok((target, there)),
        }
    }
    Err(Errno::ELOOP.into())
}

/// Whether `path` is the file that `there` describes. A link in /proc/PID/fd may name another file.
fn is_at(path: &Path, there: &Metadata) -> bool {
    fs::symlink_metadata(path).is_ok_and(|at| (at.dev(), at.ino()) == (there.dev(), there.ino()))
}

/// Writes `bytes` to `path`. Replaces a regular file, or makes a new one, in one step. Writes straight to anything else.
///
/// # Errors
/// [`Failure`], which names the file.
pub fn put(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let put = || match followed(path)? {
        (target, Some(there)) if !there.is_file() || !is_at(&target, &there) => {
            OpenOptions::new().write(true).truncate(true).open(path)?.write_all(bytes)
        }
        (target, there) => replace(&target, there.as_ref(), bytes),
    };
    put().map_err(|error| failed(path, error))
}

/// Writes a new file beside `path` and renames it into place.
fn replace(path: &Path, there: Option<&Metadata>, bytes: &[u8]) -> io::Result<()> {
    let mut beside = OsString::from(path);
    beside.push(format!(".{}.partial", std::process::id()));
    let beside = PathBuf::from(beside);
    let mut file = OpenOptions::new().write(true).create_new(true).open(&beside)?;
    let mut written = || {
        if let Some(there) = there {
            file.set_permissions(there.permissions())?;
        }
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&beside, path)
    };
    written().inspect_err(|_| {
        // The partial file is useless now.
        let _ = fs::remove_file(&beside);
    })
}

/// Writes buffered rows to a file or stdout. The file stays unchanged until the first rows are written.
pub struct Rows {
    path: PathBuf,
    file: File,
    kind: FileKind,
    stop: Interrupt,
    collected: Vec<u8>,
    /// The ends of the rows in `collected`.
    ends: Vec<usize>,
    /// How many rows are in the file, and the file's length.
    rows: u64,
    length: u64,
    /// Whether the header is being rewritten.
    rewinds: bool,
    emptied: bool,
    /// The file had a name at its opening.
    is_linked: bool,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum FileKind {
    /// A regular file that existed before.
    There,
    /// A regular file that this program made.
    New(PathBuf),
    /// A pipe, FIFO or device: it may block and has no length.
    Stream,
}

impl Rows {
    /// Opens `path`. Waits for a FIFO's reader until a signal in `stop` arrives. With `appends`, each row goes to the
    /// present end of a regular file; the header cannot be rewritten.
    ///
    /// # Errors
    /// [`Failure`], which names the file.
    pub fn open(path: &Path, appends: bool, stop: &Interrupt) -> Result<Self, Failure> {
        let opened = if is_stdout(path) {
            io::stdout().as_fd().try_clone_to_owned().map(|fd| (File::from(fd), FileKind::Stream))
        } else {
            followed(path).and_then(|(target, there)| open(path, target, there.as_ref(), appends, stop))
        };
        opened.and_then(|opened| Self::over(path, opened, stop)).map_err(|error| failed(path, error))
    }

    /// As [`Self::open`], but only a new file; `None` where any file exists.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn create_new(path: &Path, appends: bool, stop: &Interrupt) -> Result<Option<Self>, Failure> {
        let made = match OpenOptions::new().write(true).append(appends).create_new(true).open(path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Ok(None),
            made => made.map(|file| (file, FileKind::New(path.to_owned()))),
        };
        made.and_then(|made| Self::over(path, made, stop)).map(Some).map_err(|error| failed(path, error))
    }

    fn over(path: &Path, (file, kind): (File, FileKind), stop: &Interrupt) -> io::Result<Self> {
        if kind != FileKind::Stream {
            claim(&file)?;
        }
        let is_linked = file.metadata()?.nlink() > 0;
        Ok(Self {
            path: path.to_owned(),
            file,
            kind,
            stop: stop.clone(),
            collected: Vec::new(),
            ends: Vec::new(),
            rows: 0,
            length: 0,
            rewinds: false,
            emptied: false,
            is_linked,
        })
    }

    /// Whether this is a regular file, so that the header can be rewritten at the end.
    pub fn is_regular(&self) -> bool {
        self.kind != FileKind::Stream
    }

    /// The number of whole rows in the file.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// The length of the file once all rows are in it.
    pub fn bytes(&self) -> u64 {
        self.length + self.collected.len() as u64
    }

    /// Marks the end of a row.
    ///
    /// # Errors
    /// Writing failed. The file then holds whole rows, and the buffer is empty.
    pub fn end_row(&mut self) -> io::Result<()> {
        self.ends.push(self.collected.len());
        if self.collected.len() < COLLECTED { Ok(()) } else { self.send() }
    }

    /// The failure for an error in writing to this file.
    pub fn failed(&self, error: io::Error) -> Failure {
        failed(if is_stdout(&self.path) { Path::new("stdout") } else { &self.path }, error)
    }

    /// Removes a new file to which nothing has been written.
    pub fn discard(&mut self) {
        self.collected.clear();
        self.ends.clear();
        if let FileKind::New(path) = &self.kind
            && !self.emptied
        {
            // If the removal fails, an empty file remains.
            let _ = fs::remove_file(path);
        }
    }

    /// Checks that the file still has the written bytes.
    fn check_kept(&self) -> io::Result<()> {
        if !self.is_regular() {
            return Ok(());
        }
        let there = self.file.metadata()?;
        match (there.nlink() > 0, there.len() >= self.length) {
            (false, _) if self.is_linked => Err(io::Error::other(Taken::Deleted)),
            (_, false) => Err(io::Error::other(Taken::Truncated)),
            _ => Ok(()),
        }
    }

    fn send(&mut self) -> io::Result<()> {
        if let Err(error) = self.check_kept() {
            self.collected.clear();
            self.ends.clear();
            return Err(error);
        }
        if !self.emptied && self.is_regular() {
            self.file.set_len(0)?;
        }
        self.emptied = true;
        let bytes = std::mem::take(&mut self.collected);
        let ends = std::mem::take(&mut self.ends);
        let mut sent = 0;
        let mut outcome = Ok(());
        while sent < bytes.len() && outcome.is_ok() {
            match self.write_some(&bytes[sent..]) {
                Ok(0) => outcome = Err(io::ErrorKind::WriteZero.into()),
                Ok(written) => sent += written,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => outcome = Err(error),
            }
        }
        if !self.rewinds {
            let whole = ends.partition_point(|&end| end <= sent);
            self.rows += whole as u64;
            self.length += whole.checked_sub(1).map_or(0, |last| ends[last] as u64);
            if outcome.is_err() && self.is_regular() {
                // Cut off a partial row: a reader would take it for another row. If that fails too, report the first
                // error.
                let _ = self.file.set_len(self.length).and_then(|()| self.file.seek(SeekFrom::End(0)));
            }
        }
        outcome
    }

    /// As [`Write::write`], but a signal ends the wait for a reader.
    fn write_some(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_regular() {
            return self.file.write(bytes);
        }
        let mut last = None;
        loop {
            let mut fds = [PollFd::new(self.file.as_fd(), PollFlags::POLLOUT)];
            match poll(&mut fds, PollTimeout::from(LOOK_MS)) {
                Ok(0) | Err(Errno::EINTR) => {}
                Ok(_) => return self.file.write(&bytes[..bytes.len().min(PIECE)]),
                Err(error) => return Err(error.into()),
            }
            if self.stop.came() && last.get_or_insert_with(Instant::now).elapsed() > LAST {
                return Err(io::Error::other("interrupted while waiting for the reader"));
            }
        }
    }
}

impl Write for Rows {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.collected.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.send()
    }
}

impl Seek for Rows {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.send()?;
        self.rewinds = to != SeekFrom::End(0);
        self.file.seek(to)
    }
}

/// Locks `file` for this writer until the file is closed. The writer goes on if the file system has no locks, or if a
/// program that only reads the file holds a lock.
fn claim(file: &File) -> io::Result<()> {
    let lock = fcntl(file, FcntlArg::F_OFD_SETLK(&lock_of(libc::F_WRLCK)));
    if lock.is_err() && is_in_use(file) {
        return Err(io::Error::other("another program writes it"));
    }
    Ok(())
}

/// Whether another [`Rows`] writes `file`. Only a program that may write the file can lock it so.
pub fn is_in_use(file: &File) -> bool {
    let mut lock = lock_of(libc::F_RDLCK);
    fcntl(file, FcntlArg::F_OFD_GETLK(&mut lock)).is_ok() && libc::c_int::from(lock.l_type) != libc::F_UNLCK
}

/// A lock of this `kind` on a whole file.
fn lock_of(kind: libc::c_int) -> libc::flock {
    libc::flock { l_type: kind as _, l_whence: libc::SEEK_SET as _, l_start: 0, l_len: 0, l_pid: 0 }
}

fn open(
    path: &Path,
    target: PathBuf,
    there: Option<&Metadata>,
    appends: bool,
    stop: &Interrupt,
) -> io::Result<(File, FileKind)> {
    let mut options = OpenOptions::new();
    options.write(true);
    match there {
        None => {
            let made = options.append(appends).create(true).truncate(false).open(&target);
            made.map(|file| (file, FileKind::New(target)))
        }
        Some(there) if there.is_file() => {
            options.append(appends).open(path).map(|file| (file, FileKind::There))
        }
        Some(there) => {
            let file = open_fifo(options.custom_flags(OFlag::O_NONBLOCK.bits()), path, there, stop)?;
            let flags = OFlag::from_bits_truncate(fcntl(&file, FcntlArg::F_GETFL)?);
            fcntl(&file, FcntlArg::F_SETFL(flags - OFlag::O_NONBLOCK))?;
            Ok((file, FileKind::Stream))
        }
    }
}

/// Opens `path`. Waits for a reader if it is a FIFO.
fn open_fifo(options: &OpenOptions, path: &Path, there: &Metadata, stop: &Interrupt) -> io::Result<File> {
    let mut said = false;
    loop {
        match options.open(path) {
            Err(error) if error.raw_os_error() == Some(libc::ENXIO) && there.file_type().is_fifo() => {}
            opened => return opened,
        }
        if stop.came() {
            return Err(io::Error::other("interrupted while waiting for a reader of this FIFO"));
        }
        if !std::mem::replace(&mut said, true) {
            note(format_args!("{}: waiting for a reader of this FIFO", path.display()));
        }
        std::thread::sleep(Duration::from_millis(LOOK_MS.into()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::sys::stat::{Mode, SFlag, makedev, mknod};
    use std::os::unix::fs::{PermissionsExt, symlink};

    /// A device node made by the test; `None` if the test may not make one.
    fn device(path: &Path, minor: u64) -> Option<Metadata> {
        match mknod(path, SFlag::S_IFCHR, Mode::from_bits_truncate(0o666), makedev(1, minor)) {
            Err(Errno::EPERM) => return None,
            made => made.unwrap(),
        }
        // The file system allows no devices.
        let opened = OpenOptions::new().write(true).open(path);
        if opened.is_err_and(|error| error.kind() == io::ErrorKind::PermissionDenied) {
            return None;
        }
        Some(fs::symlink_metadata(path).unwrap())
    }

    fn is_same(before: &Metadata, path: &Path) -> bool {
        let after = fs::symlink_metadata(path).unwrap();
        (before.ino(), before.rdev(), before.mode()) == (after.ino(), after.rdev(), after.mode())
    }

    #[test]
    fn a_file_is_replaced_whole_or_not_at_all() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("x");
        put(&path, b"one").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        put(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o600, "who may read it");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
        let error = put(Path::new("/nonexistent/x"), b"").unwrap_err();
        assert!(matches!(&error, Failure::Request(text) if text.starts_with("/nonexistent/x: ")), "{error}");
        let error = put(directory.path(), b"").unwrap_err();
        assert!(error.to_string().ends_with("Is a directory (os error 21)"), "{error}");
    }

    #[test]
    fn links_are_followed_to_files_that_are_there_or_not() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        fs::create_dir(at("below")).unwrap();
        fs::write(at("below/target"), b"one").unwrap();
        symlink("below/target", at("link")).unwrap();
        symlink("link", at("second")).unwrap();
        symlink("below/none", at("dangling")).unwrap();
        symlink("circle", at("circle")).unwrap();
        for (name, target) in [("second", "below/target"), ("dangling", "below/none")] {
            put(&at(name), b"two").unwrap();
            assert_eq!(fs::read(at(target)).unwrap(), b"two");
            assert!(fs::symlink_metadata(at(name)).unwrap().is_symlink(), "{name}");
        }
        assert_eq!(fs::read_dir(at("below")).unwrap().count(), 2);
        let error = put(&at("circle"), b"").unwrap_err();
        assert!(error.to_string().contains("symbolic links"), "{error}");
    }

    #[test]
    fn devices_and_fifos_stay_what_they_are() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        let fifo = at("fifo");
        nix::unistd::mkfifo(&fifo, Mode::from_bits_truncate(0o600)).unwrap();
        let node = fs::symlink_metadata(&fifo).unwrap();
        let reader = std::thread::spawn({
            let fifo = fifo.clone();
            move || fs::read(fifo).unwrap()
        });
        put(&fifo, b"lines").unwrap();
        assert_eq!(reader.join().unwrap(), b"lines");
        assert!(is_same(&node, &fifo));

        let Some(node) = device(&at("full"), 7) else { return };
        symlink("full", at("link")).unwrap();
        for name in ["full", "link"] {
            let error = put(&at(name), b"lines").unwrap_err();
            assert!(error.to_string().contains(&format!("{name}: No space left")), "{error}");
        }
        assert!(is_same(&node, &at("full")));
        let node = device(&at("null"), 3).unwrap();
        put(&at("null"), b"lines").unwrap();
        assert!(is_same(&node, &at("null")));
    }

    #[test]
    fn two_do_not_write_one_file() {
        let directory = tempfile::tempdir().unwrap();
        let (stop, path) = (Interrupt::never(), directory.path().join("x"));
        let first = Rows::open(&path, true, &stop).unwrap();
        let second = Rows::open(&path, true, &stop).err().unwrap().to_string();
        assert!(second.ends_with("x: another program writes it"), "{second}");
        drop(first);
        assert!(Rows::open(&path, true, &stop).is_ok());
        assert!(Rows::create_new(&path, true, &stop).unwrap().is_none());
        // A process that can only read the file cannot pose as its writer.
        let reader = File::open(&path).unwrap();
        fcntl(&reader, FcntlArg::F_OFD_SETLK(&lock_of(libc::F_RDLCK))).unwrap();
        fcntl(&reader, FcntlArg::F_OFD_SETLK(&lock_of(libc::F_WRLCK))).unwrap_err();
        assert!(!is_in_use(&File::open(&path).unwrap()));
        assert!(Rows::open(&path, true, &stop).is_ok());
    }

    #[test]
    fn rows_go_to_the_end_of_a_file_that_is_truncated_between_the_look_at_it_and_the_write() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("x");
        let mut rows = Rows::open(&path, true, &Interrupt::never()).unwrap();
        rows.write_all(b"1\n").unwrap();
        rows.end_row().unwrap();
        rows.flush().unwrap();
        fs::write(&path, "").unwrap();
        let error = rows.flush().unwrap_err();
        assert!(is_taken(&error) && error.to_string().starts_with("another program truncated it"), "{error}");
        rows.length = 0;
        rows.write_all(b"2\n").unwrap();
        rows.flush().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"2\n", "no hole of zeros");
    }

    #[test]
    fn nothing_is_touched_before_the_first_rows_are_written() {
        let directory = tempfile::tempdir().unwrap();
        let stop = Interrupt::never();
        let path = directory.path().join("x");
        let mut rows = Rows::open(&path, true, &stop).unwrap();
        rows.write_all(b"row\n").unwrap();
        rows.discard();
        assert!(!path.exists());
        fs::write(&path, b"what was there before").unwrap();
        let mut rows = Rows::open(&path, true, &stop).unwrap();
        rows.write_all(b"row\n").unwrap();
        rows.end_row().unwrap();
        rows.discard();
        assert_eq!(fs::read(&path).unwrap(), b"what was there before");
        drop(rows);
        let mut rows = Rows::open(&path, true, &stop).unwrap();
        rows.write_all(b"row\n").unwrap();
        rows.end_row().unwrap();
        rows.flush().unwrap();
        assert_eq!((fs::read(&path).unwrap(), rows.rows()), (b"row\n".to_vec(), 1));
    }
}
