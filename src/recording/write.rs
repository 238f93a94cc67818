//! Writes a recording piece by piece.

use std::fs::{self, DirBuilder, File, Metadata, OpenOptions};
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::os::fd::AsFd as _;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use nix::fcntl::OFlag;
use nix::unistd::geteuid;

use serde::Serialize;
use serde_json::Value;

use super::{About, Access, Answer, FORMAT, ImageAt, RecordingError, files};
use crate::process::path_of;

/// The writer collects lines up to this many bytes.
const COLLECTED: usize = 1 << 16;

/// An unfinished recording. Until [`Writer::finish`], its [`About`] says that it is cut short.
///
/// The recording stays in its first directory, whatever takes the directory's place, and no other user can put a link
/// there: through a link, a recording by root would write over another file.
#[derive(Debug)]
pub struct Writer {
    directory: PathBuf,
    held: File,
    trace: LineFile,
    answers: LineFile,
    image_times: LineFile,
}

impl Writer {
    /// Begins a recording in `directory`, and creates the directory if it is missing.
    ///
    /// # Errors
    /// `directory` is not empty, other users may write into it, or this process may not.
    pub fn create(directory: &Path, about: &About) -> Result<Self, RecordingError> {
        let held = made(directory).map_err(RecordingError::io(directory))?;
        let inside = path_of(held.as_fd());
        let metadata = held.metadata().map_err(RecordingError::io(directory))?;
        let mut entries = fs::read_dir(&inside).map_err(RecordingError::io(directory))?;
        let what = match (others(&metadata), entries.next()) {
            (Some(others), _) => Some(others),
            (None, Some(_)) => Some("it is not empty".to_owned()),
            (None, None) => None,
        };
        if let Some(what) = what {
            let what = format!("{what}: name a directory that is not there yet");
            return Err(RecordingError::Unfit { path: directory.to_owned(), what });
        }
        // Sets the mode regardless of the umask and of a default ACL of the directory above.
        DirBuilder::new()
            .mode(0o755)
            .create(inside.join(files::IMAGES))
            .map_err(RecordingError::io(directory.join(files::IMAGES)))?;
        let file = |name: &str| LineFile::create(&inside.join(name), directory.join(name));
        let writer = Self {
            directory: directory.to_owned(),
            held,
            trace: file(files::TRACE)?,
            answers: file(files::ANSWERS)?,
            image_times: file(files::IMAGE_TIMES)?,
        };
        writer.about(about)?;
        Ok(writer)
    }

    /// Adds an access.
    ///
    /// # Errors
    /// Writing fails. The file then holds whole lines.
    pub fn access(&mut self, access: &Access) -> Result<(), RecordingError> {
        self.trace.add(access)
    }

    /// Adds an answer, and flushes it to the file.
    ///
    /// # Errors
    /// As [`Self::access`].
    pub fn answer(&mut self, answer: &Answer) -> Result<(), RecordingError> {
        self.answers.add(answer)?;
        self.answers.send()
    }

    /// Adds an image, and flushes it to the files.
    ///
    /// # Errors
    /// Writing fails. The file of the images' times does not name the rest of the image.
    pub fn image(&mut self, t_ns: u64, words: &[u16]) -> Result<(), RecordingError> {
        let file = format!("{:04}.bin", self.image_times.lines);
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        self.put(&Path::new(files::IMAGES).join(&file), &bytes)?;
        self.image_times.add(&ImageAt { t_ns, file })?;
        self.image_times.send()
    }

    /// Writes the variables.
    ///
    /// # Errors
    /// Writing fails. The recording then has no such file.
    pub fn variables(&self, text: &str) -> Result<(), RecordingError> {
        self.put(Path::new(files::VARIABLES), text.as_bytes())
    }

    /// Writes the facts about the machine.
    ///
    /// # Errors
    /// As [`Self::variables`].
    pub fn system(&self, document: &Value) -> Result<(), RecordingError> {
        self.document(files::SYSTEM, document)
    }

    /// The recording's directory, wherever its path leads by now.
    ///
    /// # Errors
    /// The process has no descriptor left.
    pub fn directory(&self) -> io::Result<File> {
        self.held.try_clone()
    }

    /// How many accesses are in the file.
    #[must_use]
    pub fn accesses(&self) -> u64 {
        self.trace.lines
    }

    /// How many images the recording has.
    #[must_use]
    pub fn images(&self) -> u64 {
        self.image_times.lines
    }

    /// Ends the recording: writes the collected accesses, and `about` with their number. If `about` says why the
    /// recording is cut short, or writing fails, the recording says so for good. Returns the number of accesses.
    ///
    /// # Errors
    /// Writing fails.
    pub fn finish(mut self, about: About) -> Result<u64, RecordingError> {
        let sent = self.trace.send();
        let failed = sent.as_ref().err().map(ToString::to_string);
        let about = About { accesses: self.trace.lines, cut_short: about.cut_short.or(failed), ..about };
        self.about(&about)?;
        sent.map(|()| about.accesses)
    }

    fn about(&self, about: &About) -> Result<(), RecordingError> {
        self.document(files::ABOUT, &About { format: FORMAT, ..about.clone() })
    }

    fn document<T: Serialize>(&self, name: &str, document: &T) -> Result<(), RecordingError> {
        let mut text = serde_json::to_vec_pretty(document)
            .map_err(|error| RecordingError::io(self.directory.join(name))(error.into()))?;
        text.push(b'\n');
        self.put(Path::new(name), &text)
    }

    /// Writes a file as a whole, or leaves the old one.
    fn put(&self, name: &Path, bytes: &[u8]) -> Result<(), RecordingError> {
        let path = path_of(self.held.as_fd()).join(name);
        let beside = path.with_extension("partial");
        let written = created(&beside)
            .and_then(|mut file| file.write_all(bytes))
            .and_then(|()| fs::rename(&beside, path));
        written.map_err(|error| {
            // The partial file is useless now.
            let _ = fs::remove_file(&beside);
            RecordingError::io(self.directory.join(name))(error)
        })
    }
}

/// The directory, opened: a new or an existing one.
fn made(directory: &Path) -> io::Result<File> {
    // With a slash behind it, the kernel would follow a link.
    let directory = directory.components().as_path();
    if let Some(parent) = directory.parent() {
        fs::create_dir_all(parent)?;
    }
    match DirBuilder::new().mode(0o755).create(directory) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    let flags = OFlag::O_DIRECTORY | OFlag::O_NOFOLLOW;
    OpenOptions::new().read(true).custom_flags(flags.bits()).open(directory)
}

/// A new file that only its owner may write, whatever the umask: in a directory with the setgid bit the file has the
/// directory's group.
fn created(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).create_new(true).mode(0o644).open(path)
}

/// The other users who may write into a directory.
fn others(directory: &Metadata) -> Option<String> {
    if directory.uid() != geteuid().as_raw() {
        return Some(format!("it belongs to uid {}", directory.uid()));
    }
    (directory.mode() & 0o022 != 0).then(|| "others may write into it (chmod go-w)".to_owned())
}

/// A file of lines, each a JSON document. When a write fails, whole lines remain.
#[derive(Debug)]
struct LineFile {
    path: PathBuf,
    file: File,
    collected: Vec<u8>,
    collected_lines: u64,
    /// How many lines the file has.
    lines: u64,
    length: u64,
}

impl LineFile {
    /// The file `at`, which errors name `path`.
    fn create(at: &Path, path: PathBuf) -> Result<Self, RecordingError> {
        let file = created(at).map_err(RecordingError::io(&path))?;
        Ok(Self { path, file, collected: Vec::new(), collected_lines: 0, lines: 0, length: 0 })
    }

    fn add<T: Serialize>(&mut self, line: &T) -> Result<(), RecordingError> {
        let written = serde_json::to_writer(&mut self.collected, line);
        written.map_err(|error| RecordingError::io(&self.path)(error.into()))?;
        self.collected.push(b'\n');
        self.collected_lines += 1;
        if self.collected.len() < COLLECTED { Ok(()) } else { self.send() }
    }

    fn send(&mut self) -> Result<(), RecordingError> {
        let sent = self.file.write_all(&self.collected);
        match &sent {
            Ok(()) => {
                self.lines += self.collected_lines;
                self.length += self.collected.len() as u64;
            }
            Err(_) => self.cut(),
        }
        self.collected.clear();
        self.collected_lines = 0;
        sent.map_err(RecordingError::io(&self.path))
    }

    /// Removes a partial line. If the removal fails too, the caller reports the first error.
    fn cut(&mut self) {
        let _ = self.file.set_len(self.length).and_then(|()| self.file.seek(SeekFrom::End(0)).map(drop));
    }
}
