//! `pmacctl doctor --report`: one file to send to a helper. A tar of text files and a short capture, without the user's
//! names and paths.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::fd::AsFd as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use flate2::Compression;
use flate2::write::GzEncoder;
use nix::unistd::mkdtemp;
use serde_json::{Value, json};
use tar::{Builder, Header};

use super::report::Report;
use crate::cli::capture::{self, Capture, Taken};
use crate::cli::context::{Context, Failure};
use crate::cli::show::status;
use crate::device::without_paths;
use crate::process::path_of;

/// How long to trace the bus accesses: a few megabytes.
const TRACED: Duration = Duration::from_millis(200);
/// The directory inside the file.
const INSIDE: &str = "pmac-report";
/// Keys of documents that name users.
const USERS: [&str; 2] = ["owner_uid", "uid"];

/// Writes `report`, `status` and a short capture to the new file `path`; prints its contents. True unless the capture
/// was cut short.
pub fn write(context: &mut Context, report: &Report, path: &Path) -> Result<bool, Failure> {
    let failed = |error: io::Error| Failure::Request(format!("{}: {error}", path.display()));
    let file = OpenOptions::new().write(true).create_new(true).open(path).map_err(failed)?;
    let packed = Packed::of(path, file);
    let written = Own::make().and_then(|directory| fill(context, report, packed, &directory.0));
    let (note, is_whole) = written.inspect_err(|_| {
        // A partial file is useless.
        let _ = fs::remove_file(path);
    })?;
    context.output.line(&note)?;
    let kilobytes = fs::metadata(path).map_err(failed)?.len().div_ceil(1000);
    context.output.line(format_args!("{}: {kilobytes} kB", path.display()))?;
    let not_whole = if is_whole { "" } else { "not whole, as said above; " };
    context
        .output
        .line(format_args!("{}: {not_whole}look at it before you send it (tar -xf)", path.display()))?;
    Ok(is_whole)
}

/// A private directory, closed to other users, removed at the end.
struct Own(PathBuf);

impl Own {
    /// The directory for temporary files. No other user can write into it, and the program reads each file by the
    /// descriptor that wrote it.
    fn make() -> Result<Self, Failure> {
        let path = std::env::temp_dir().join("pmac-report-XXXXXX");
        let made = mkdtemp(&path).map_err(|error| Failure::Request(format!("{}: {error}", path.display())));
        made.map(Self)
    }
}

impl Drop for Own {
    fn drop(&mut self) {
        // If the removal fails, the directory's name tells its purpose.
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn fill(
    context: &Context,
    report: &Report,
    file: Packed,
    directory: &Path,
) -> Result<(String, bool), Failure> {
    let status = status::look(context)?;
    let private = Private::of(&status, &context.socket());
    let options = Capture { directory: directory.to_owned(), seconds: TRACED, no_variables: false };
    let taken = capture::take(context, &options);
    let note = private.shown(&note(&taken));
    let mut tar = Tar::begin(file)?;
    tar.add("README.txt", note.as_bytes())?;
    tar.add("doctor.json", &private.text(&json!(report.0))?)?;
    tar.add("status.json", &private.text(&status)?)?;
    if let Ok(taken) = &taken {
        tar.add_directory("capture", &path_of(taken.directory.as_fd()))?;
    }
    tar.end()?;
    Ok((note, taken.is_ok_and(|taken| taken.summary.cut_short.is_none() && !taken.summary.lacks_answers)))
}

/// The note on the contents of the file, and on the parts left out.
fn note(taken: &Result<Taken, Failure>) -> String {
    let mut note = format!(
        "What {INSIDE} holds, of pmacctl {}:\n  doctor.json, status.json: what pmacctl doctor and pmacctl status say\n",
        env!("CARGO_PKG_VERSION")
    );
    match taken {
        Ok(taken) => {
            note += "  capture: variables, images of the DPRAM and what pmacd read and wrote, for a moment; the machine's kernel and \
                     the board's device\n";
            if let Some(why) = &taken.summary.cut_short {
                note += &format!("  The capture is cut short: {why}\n");
            }
        }
        Err(why) => note += &format!("  no capture: {why}\n"),
    }
    note += "What it does not hold:\n";
    for sentence in taken.iter().flat_map(|taken| &taken.summary.left_out) {
        note += &format!("  {sentence}\n");
    }
    note + "  paths of the socket and of your home directory, numbers of users"
}

/// The user's texts in the documents, and their replacements.
struct Private(Vec<(String, String)>);

impl Private {
    /// The texts known from `status` and from the environment, and the `socket`, even without a daemon there.
    fn of(status: &Value, socket: &Path) -> Self {
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let home = std::env::var("HOME").unwrap_or_default();
        let board = text(&status["socket"]["board"]);
        let shown = without_paths(&board);
        let all = [
            (board, shown),
            (socket.display().to_string(), "SOCKET".to_owned()),
            // Root's home occurs in many names.
            (if home == "/" { String::new() } else { home }, "~".to_owned()),
        ];
        Self(all.into_iter().filter(|(from, _)| !from.is_empty()).collect())
    }

    /// The text without the user's texts and without user numbers.
    fn shown(&self, text: &str) -> String {
        let told = self.0.iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, to));
        capture::without_users(&told)
    }

    /// The document without the user's texts.
    fn text(&self, document: &Value) -> Result<Vec<u8>, Failure> {
        let mut document = document.clone();
        self.clean(&mut document);
        serde_json::to_vec_pretty(&document).map_err(Failure::request)
    }

    fn clean(&self, value: &mut Value) {
        match value {
            Value::String(text) => *text = self.shown(text),
            Value::Array(values) => values.iter_mut().for_each(|value| self.clean(value)),
            Value::Object(fields) => {
                fields.retain(|key, _| !USERS.contains(&key.as_str()));
                fields.values_mut().for_each(|value| self.clean(value));
            }
            _ => {}
        }
    }
}

/// The bytes of the file; compressed if its name says so.
enum Packed {
    Plain(BufWriter<File>),
    Gzip(GzEncoder<BufWriter<File>>),
}

impl Packed {
    fn of(path: &Path, file: File) -> Self {
        let file = BufWriter::new(file);
        match path.extension().is_some_and(|name| name == "gz" || name == "tgz") {
            true => Self::Gzip(GzEncoder::new(file, Compression::default())),
            false => Self::Plain(file),
        }
    }

    fn end(self) -> io::Result<()> {
        let mut file = match self {
            Self::Plain(file) => file,
            Self::Gzip(encoder) => encoder.finish()?,
        };
        file.flush()
    }
}

impl Write for Packed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(file) => file.write(bytes),
            Self::Gzip(encoder) => encoder.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(file) => file.flush(),
            Self::Gzip(encoder) => encoder.flush(),
        }
    }
}

/// The file.
struct Tar {
    builder: Builder<Packed>,
    mtime: u64,
}

impl Tar {
    fn begin(file: Packed) -> Result<Self, Failure> {
        let mtime = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        Ok(Self { builder: Builder::new(file), mtime })
    }

    fn add(&mut self, name: &str, bytes: &[u8]) -> Result<(), Failure> {
        let mut header = Header::new_ustar();
        header.set_mode(0o644);
        header.set_mtime(self.mtime);
        header.set_size(bytes.len() as u64);
        Ok(self.builder.append_data(&mut header, format!("{INSIDE}/{name}"), bytes)?)
    }

    fn add_directory(&mut self, name: &str, directory: &Path) -> Result<(), Failure> {
        let mut entries: Vec<_> = fs::read_dir(directory)?.collect::<Result<_, _>>()?;
        entries.sort_by_key(fs::DirEntry::file_name);
        for entry in entries {
            let name = format!("{name}/{}", entry.file_name().to_string_lossy());
            let kind = entry.file_type()?;
            if kind.is_dir() {
                self.add_directory(&name, &entry.path())?;
            } else if kind.is_file() {
                self.add(&name, &fs::read(entry.path())?)?;
            }
        }
        Ok(())
    }

    fn end(self) -> Result<(), Failure> {
        Ok(self.builder.into_inner()?.end()?)
    }
}
