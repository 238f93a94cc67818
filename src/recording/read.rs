//! Reads a recording.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead as _, BufReader, Read as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::fcntl::OFlag;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{
    About, Access, Answer, FORMAT, Image, ImageAt, MOST_ACCESSES, MOST_ANSWERS, MOST_IMAGES, RecordingError,
    files,
};
use crate::map::Family;

/// The longest line, in bytes.
const LONGEST_LINE: u64 = 64 << 10;
/// The largest file that this program reads as a whole, in bytes.
const LARGEST: u64 = 16 << 20;

/// A recording in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The capture's board and settings.
    pub about: About,
    /// The images, in the order of their times.
    pub images: Vec<Image>,
    /// The accesses, in the order of their times.
    pub accesses: Vec<Access>,
    /// The answers, in the order of their questions.
    pub answers: Vec<Answer>,
    /// Variables and definitions, as `pmacctl backup` writes them; `None` if the recording has none.
    pub variables: Option<String>,
    /// The machine; null if the recording has none.
    pub system: Value,
}

impl Recording {
    /// Reads the recording in `directory`.
    ///
    /// # Errors
    /// [`RecordingError`], which names the file, and the line of a damaged file.
    pub fn read(directory: &Path) -> Result<Self, RecordingError> {
        let about = about(directory)?;
        // Checked before the first image: an impossible size would take gigabytes of memory.
        about.family(directory)?;
        let accesses = Accesses::of(directory, &about)?.collect::<Result<_, _>>()?;
        let answers = answers(directory, &about)?;
        let mut images: Vec<Image> = Vec::new();
        let images_at = directory.join(files::IMAGES);
        if images_at.is_symlink() {
            return Err(RecordingError::Unfit { path: images_at, what: "a link, no directory".to_owned() });
        }
        let mut times = Lines::<ImageAt>::open(directory, files::IMAGE_TIMES, &about, MOST_IMAGES)?;
        let mut named = BTreeSet::new();
        while let Some(line) = times.next() {
            let (number, at) = line?;
            let damaged = |what: &str| times.damaged(number, what.to_owned());
            if at.file.contains('/') || at.file.starts_with('.') {
                return Err(damaged("an image lies in the directory of images"));
            }
            if images.last().is_some_and(|last| last.t_ns > at.t_ns) {
                return Err(damaged("earlier than the image before it"));
            }
            // Otherwise a few bytes of a hostile capture would become gigabytes of memory.
            if !named.insert(at.file.clone()) {
                return Err(damaged("an image that is there already"));
            }
            images.push(image(&images_at.join(&at.file), at.t_ns, &about)?);
        }
        let variables = whole(&directory.join(files::VARIABLES))?;
        let path = directory.join(files::SYSTEM);
        let system = whole(&path)?.map_or(Ok(Value::Null), |text| json(&path, &text))?;
        Ok(Self { about, images, accesses, answers, variables, system })
    }
}

impl About {
    /// Reads the head of the recording in `directory`.
    ///
    /// # Errors
    /// [`RecordingError`].
    pub fn read(directory: &Path) -> Result<Self, RecordingError> {
        about(directory)
    }

    /// The board's family, with the capture's size of DPRAM. The recording is in `directory`.
    ///
    /// # Errors
    /// No family has such a DPRAM.
    pub fn family(&self, directory: &Path) -> Result<&'static Family, RecordingError> {
        let unfit = |what: String| RecordingError::Unfit { path: directory.join(files::ABOUT), what };
        let family = Family::by_name(&self.family).map_err(|error| unfit(error.to_string()))?;
        let what = || unfit(format!("no {} has a DPRAM of {} bytes", family.title, self.dpram_bytes));
        family.with_length(self.dpram_bytes).ok_or_else(what)
    }
}

/// Opens a plain file. A FIFO could keep this program waiting, and a link leads out of the capture.
fn open(path: &Path) -> io::Result<File> {
    let flags = OFlag::O_NOFOLLOW | OFlag::O_NONBLOCK;
    let file = OpenOptions::new().read(true).custom_flags(flags.bits()).open(path).map_err(|error| {
        if error.raw_os_error() == Some(Errno::ELOOP as i32) {
            io::Error::other("a link, no plain file")
        } else {
            error
        }
    })?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(io::Error::other("no plain file")) }
}

/// Reads [`files::ABOUT`].
fn about(directory: &Path) -> Result<About, RecordingError> {
    let path = directory.join(files::ABOUT);
    let unfit = |what: String| RecordingError::Unfit { path: path.clone(), what };
    let text = whole(&path)?.ok_or_else(|| {
        unfit("not there: this is no capture, or one that ended before it began".to_owned())
    })?;
    // The version comes first: another version may write the rest otherwise.
    let document: Value = json(&path, &text)?;
    if document["format"] != FORMAT {
        let format = &document["format"];
        return Err(unfit(format!("a capture of format {format}; this program reads {FORMAT}")));
    }
    json(&path, &text)
}

/// Reads [`files::ANSWERS`].
fn answers(directory: &Path, about: &About) -> Result<Vec<Answer>, RecordingError> {
    let mut lines = Lines::<Answer>::open(directory, files::ANSWERS, about, MOST_ANSWERS)?;
    let mut answers = Vec::new();
    let mut bytes = 0;
    while let Some(line) = lines.next() {
        let (number, answer) = line?;
        // An empty line of a reply takes memory, too.
        bytes += answer.reply.iter().map(|line| line.len() + size_of::<String>()).sum::<usize>();
        if bytes as u64 > LARGEST {
            return Err(lines.damaged(number, format!("the replies take more than {LARGEST} bytes")));
        }
        answers.push(answer);
    }
    Ok(answers)
}

fn image(path: &Path, t_ns: u64, about: &About) -> Result<Image, RecordingError> {
    let length = u64::from(about.dpram_bytes);
    let mut bytes = Vec::new();
    let file = open(path).map_err(RecordingError::io(path))?;
    file.take(length + 1).read_to_end(&mut bytes).map_err(RecordingError::io(path))?;
    if bytes.len() as u64 != length || length % 2 != 0 {
        let what = format!("not the {length} bytes of the DPRAM that {} tells", files::ABOUT);
        return Err(RecordingError::Unfit { path: path.to_owned(), what });
    }
    let (words, _) = bytes.as_chunks();
    Ok(Image { t_ns, words: words.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect() })
}

/// A file as text; `None` without the file.
fn whole(path: &Path) -> Result<Option<String>, RecordingError> {
    let file = match open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        opened => opened.map_err(RecordingError::io(path))?,
    };
    let mut text = String::new();
    file.take(LARGEST + 1).read_to_string(&mut text).map_err(RecordingError::io(path))?;
    if text.len() as u64 > LARGEST {
        let what = format!("longer than {LARGEST} bytes");
        return Err(RecordingError::Unfit { path: path.to_owned(), what });
    }
    Ok(Some(text))
}

fn json<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, RecordingError> {
    serde_json::from_str(text).map_err(|error| RecordingError::Damaged {
        path: path.to_owned(),
        line: error.line(),
        what: reason(&error),
    })
}

/// Why the text is not such a document; the caller's message names the place.
fn reason(error: &serde_json::Error) -> String {
    let text = error.to_string();
    text.rsplit_once(" at line ").map_or(text.as_str(), |(what, _)| what).to_owned()
}

/// The accesses of a recording, one after the other.
pub struct Accesses {
    lines: Lines<Access>,
    length: u32,
    last_ns: u64,
}

impl Accesses {
    /// The images in `directory`, whose [`About`] is `about`.
    ///
    /// # Errors
    /// This program cannot open the file.
    pub fn of(directory: &Path, about: &About) -> Result<Self, RecordingError> {
        let lines = Lines::open(directory, files::TRACE, about, MOST_ACCESSES)?;
        Ok(Self { lines, length: about.dpram_bytes, last_ns: 0 })
    }
}

impl Iterator for Accesses {
    type Item = Result<Access, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        let (number, access) = match self.lines.next()? {
            Ok(line) => line,
            Err(error) => return Some(Err(error)),
        };
        let early = (access.t_ns < self.last_ns).then(|| "earlier than the access before it".to_owned());
        self.last_ns = access.t_ns;
        let fault = access.fault(self.length).or(early);
        Some(fault.map_or(Ok(access), |what| Err(self.lines.damaged(number, what))))
    }
}

/// The lines of a file, each a JSON document; none without the file. Ends behind the first wrong line.
pub(super) struct Lines<T> {
    path: PathBuf,
    file: Option<BufReader<File>>,
    number: usize,
    most: usize,
    /// The last line may be incomplete.
    is_cut: bool,
    line: Vec<u8>,
    kind: std::marker::PhantomData<T>,
}

impl<T: DeserializeOwned> Lines<T> {
    pub(super) fn open(
        directory: &Path,
        name: &str,
        about: &About,
        most: usize,
    ) -> Result<Self, RecordingError> {
        let path = directory.join(name);
        let file = match open(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            opened => Some(BufReader::new(opened.map_err(RecordingError::io(&path))?)),
        };
        let is_cut = about.cut_short.is_some();
        Ok(Self { path, file, number: 0, most, is_cut, line: Vec::new(), kind: std::marker::PhantomData })
    }

    fn damaged(&self, line: usize, what: String) -> RecordingError {
        RecordingError::Damaged { path: self.path.clone(), line, what }
    }

    fn read(&mut self) -> Result<Option<T>, RecordingError> {
        let Some(file) = &mut self.file else { return Ok(None) };
        self.line.clear();
        let read = file.take(LONGEST_LINE).read_until(b'\n', &mut self.line);
        if read.map_err(RecordingError::io(&self.path))? == 0 {
            return Ok(None);
        }
        self.number += 1;
        if self.line.last() != Some(&b'\n') {
            if self.line.len() as u64 == LONGEST_LINE {
                return Err(self.damaged(self.number, format!("longer than {LONGEST_LINE} bytes")));
            }
            if self.is_cut {
                return Ok(None);
            }
            return Err(self.damaged(self.number, "the line has no end".to_owned()));
        }
        if self.number > self.most {
            return Err(self.damaged(self.number, format!("more than {} lines", self.most)));
        }
        let line = serde_json::from_slice(&self.line[..self.line.len() - 1]);
        line.map(Some).map_err(|error| self.damaged(self.number, reason(&error)))
    }
}

impl<T: DeserializeOwned> Iterator for Lines<T> {
    type Item = Result<(usize, T), RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        let read = self.read();
        if !matches!(read, Ok(Some(_))) {
            self.file = None;
        }
        read.map(|line| line.map(|line| (self.number, line))).transpose()
    }
}
