//! The files of a log: one file, or a series. The log begins another file of a series by size or time, and removes the
//! oldest.
//!
//! A full disk does not end the log: whole rows stay, the log counts as lost the rows that find no room, and it tries
//! again.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::fcntl::OFlag;

use super::row::GAP;
use super::series::{HIGHEST_NUMBER, newest, place, series};
use crate::cli::console::sink::is_in_use;
use crate::cli::console::{Interrupt, TableFile, is_stdout, note};
use crate::cli::context::Failure;
use crate::client::Gap;
use crate::table::Field;

/// The time after which the log tries a full disk again.
const TRY_AGAIN: Duration = Duration::from_secs(1);
/// The log writes its collected rows and removes old files this often, even if the buffer is not full.
const TEND: Duration = Duration::from_secs(1);
/// The conditions for another file, and the bytes to keep.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rotation {
    /// Begin another file at this many bytes.
    pub bytes: Option<u64>,
    /// Begin another file at this age.
    pub age: Option<Duration>,
    /// The bytes that all files of the series may take.
    pub keep: Option<u64>,
}

impl Rotation {
    fn is_wanted(self) -> bool {
        self.bytes.is_some() || self.age.is_some() || self.keep.is_some()
    }

    /// The size at which the log begins another file: a quarter of the bytes for all files, where that is less.
    fn limit(self) -> Option<u64> {
        [self.bytes, self.keep.map(|keep| keep / 4)].into_iter().flatten().min()
    }
}

/// The meaning of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowMeaning {
    Update,
    /// The log read an update without knowing its scale: the update counts as missed.
    Unscaled,
    Gap(Gap),
}

/// Counts of the updates in the files, and of those missed and lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    pub updates: u64,
    pub missed: u64,
    pub lost: u64,
}

impl Tally {
    fn add(&mut self, meaning: RowMeaning) {
        match meaning {
            RowMeaning::Update => self.updates += 1,
            RowMeaning::Unscaled => self.missed += 1,
            RowMeaning::Gap(gap) => {
                self.missed += gap.missed;
                self.lost += gap.lost;
            }
        }
    }

    /// Adds a row that was not written, as part of a gap.
    fn add_unwritten(&mut self, meaning: RowMeaning) {
        match meaning {
            RowMeaning::Update => self.lost += 1,
            RowMeaning::Unscaled | RowMeaning::Gap(_) => self.add(meaning),
        }
    }
}

/// How often board or `pmacd` paused, and how long in all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pauses {
    pub count: u64,
    pub time: Duration,
}

/// The files of a log.
pub struct Files {
    path: PathBuf,
    fields: Vec<Field>,
    rotation: Rotation,
    stop: Interrupt,
    file: TableFile,
    began: Instant,
    tended: Instant,
    /// Another file found no room: the time of the next try.
    rotates_from: Option<Instant>,
    /// The number of the present file, 0 without a series, and the number of the file before it.
    number: u64,
    previous: Option<u64>,
    /// The counts of the rows in the files.
    written: Tally,
    /// The rows handed to the present file that it may not hold yet.
    pending: Vec<RowMeaning>,
    kept: u64,
    /// The number of missed updates that the log read.
    unscaled: u64,
    pauses: Pauses,
    /// The counts of the rows that found no room since the last written row.
    unwritten: Tally,
    /// Until this time the disk counts as full.
    full_until: Option<Instant>,
    /// Since the message about the full disk no row has found room.
    is_full: bool,
    /// A row without values, for gaps.
    gap_row: Vec<f64>,
}

impl Files {
    /// Opens the first file.
    ///
    /// # Errors
    /// [`Failure`]: the name does not fit, or the file cannot be opened.
    pub fn open(
        path: &Path,
        fields: Vec<Field>,
        rotation: Rotation,
        stop: &Interrupt,
    ) -> Result<Self, Failure> {
        if is_stdout(path) && rotation.is_wanted() {
            return Err(Failure::Request("stdout is one file: it cannot rotate or keep less".to_owned()));
        }
        let (number, file) = if rotation.is_wanted() {
            next(path, newest(path)? + 1, &fields, stop)?
        } else {
            (0, TableFile::open(path, &fields, stop)?)
        };
        Ok(Self {
            path: path.to_owned(),
            rotation,
            stop: stop.clone(),
            file,
            began: Instant::now(),
            tended: Instant::now(),
            rotates_from: None,
            number,
            previous: None,
            written: Tally::default(),
            pending: Vec::new(),
            kept: 0,
            unscaled: 0,
            pauses: Pauses::default(),
            unwritten: Tally::default(),
            full_until: None,
            is_full: false,
            gap_row: vec![f64::NAN; fields.len()],
            fields,
        })
    }

    /// The name of the present file.
    pub fn present(&self) -> PathBuf {
        place(&self.path, self.number)
    }

    /// The counts of the rows in the files and of the rows that found no room.
    pub fn tally(&self) -> Tally {
        let Tally { updates, missed, lost } = self.written;
        let Tally { missed: more_missed, lost: more_lost, .. } = self.unwritten;
        Tally { updates, missed: missed + more_missed, lost: lost + more_lost }
    }

    /// How many of the missed updates the log read without knowing their scale.
    pub fn unscaled(&self) -> u64 {
        self.unscaled
    }

    /// The pauses, whether their rows found room or not.
    pub fn pauses(&self) -> Pauses {
        self.pauses
    }

    /// Lost updates that a row in the files reports, and lost updates that no row reports yet, for want of room.
    pub fn lost(&self) -> (u64, u64) {
        (self.written.lost, self.unwritten.lost)
    }

    /// Writes one row.
    ///
    /// # Errors
    /// [`Failure`]: the log cannot write to the output, for another cause than want of room.
    pub fn row(&mut self, row: &[f64], meaning: RowMeaning) -> Result<(), Failure> {
        self.unscaled += u64::from(meaning == RowMeaning::Unscaled);
        if let RowMeaning::Gap(Gap { pause: Some(time), .. }) = meaning {
            self.pauses.count += 1;
            self.pauses.time += time;
        }
        if self.full_until.is_some_and(|until| Instant::now() < until) {
            self.unwritten.add_unwritten(meaning);
            return Ok(());
        }
        let Tally { missed, lost, .. } = std::mem::take(&mut self.unwritten);
        if missed + lost > 0 {
            let gap = Gap { missed, lost, pause: None };
            // With the number and times of the row after the gap: the log no longer has the number and times of the row
            // before.
            self.gap_row[..GAP.start].copy_from_slice(&row[..GAP.start]);
            self.gap_row[GAP].copy_from_slice(&[missed as f64, lost as f64]);
            let row = std::mem::take(&mut self.gap_row);
            let put = self.put(&row, RowMeaning::Gap(gap));
            self.gap_row = row;
            put?;
        }
        self.put(row, meaning)
    }

    fn put(&mut self, row: &[f64], meaning: RowMeaning) -> Result<(), Failure> {
        self.pending.push(meaning);
        let put = self.file.row(row);
        self.settle(put)?;
        if self.rotation.limit().is_some_and(|limit| self.file.bytes() >= limit) {
            self.rotate()?;
        }
        Ok(())
    }

    /// Once a second, writes the collected rows, so that others can read them, and removes old files.
    ///
    /// # Errors
    /// As [`Files::row`].
    pub fn tend(&mut self) -> Result<(), Failure> {
        if self.rotation.age.is_some_and(|age| self.began.elapsed() >= age) {
            self.rotate()?;
        }
        if self.tended.elapsed() < TEND {
            return Ok(());
        }
        self.tended = Instant::now();
        self.flush()?;
        self.remove_oldest();
        Ok(())
    }

    /// Begins another file, if the present file has rows. If the new file finds no room, the log goes on with the
    /// present file.
    fn rotate(&mut self) -> Result<(), Failure> {
        if self.rotates_from.is_some_and(|from| Instant::now() < from) {
            return Ok(());
        }
        self.flush()?;
        if self.file.kept() == 0 {
            return Ok(());
        }
        let newest = newest(&self.path).unwrap_or_default().max(self.number);
        match next(&self.path, newest + 1, &self.fields, &self.stop) {
            Ok((number, file)) => {
                self.file = file;
                self.previous = Some(std::mem::replace(&mut self.number, number));
                self.kept = 0;
                self.rotates_from = None;
                self.remove_oldest();
            }
            Err(failure) => {
                note(format_args!("{failure}; {} goes on", self.present().display()));
                self.rotates_from = Some(Instant::now() + TRY_AGAIN);
            }
        }
        self.began = Instant::now();
        Ok(())
    }

    /// Writes the rest.
    ///
    /// # Errors
    /// As [`Files::row`].
    pub fn finish(&mut self) -> Result<(), Failure> {
        self.flush()?;
        if self.file.kept() == 0
            && let Some(previous) = self.previous.take()
        {
            // The last row has filled the file before: the present file has none.
            self.file.discard();
            self.number = previous;
        }
        self.remove_oldest();
        Ok(())
    }

    /// Writes the collected rows. Without a row does nothing: a head alone must not replace an existing recording.
    fn flush(&mut self) -> Result<(), Failure> {
        if self.kept == 0 && self.pending.is_empty() {
            return Ok(());
        }
        let put = self.file.finish();
        self.settle(put)
    }

    /// Removes the file if nothing has been written to it.
    pub fn discard(&mut self) {
        self.file.discard();
    }

    /// Counts the rows that the file holds by now, and the rows that found no room.
    fn settle(&mut self, put: Result<(), Failure>) -> Result<(), Failure> {
        let kept = self.file.kept();
        let whole = usize::try_from(kept - self.kept).unwrap_or(usize::MAX).min(self.pending.len());
        self.pending.drain(..whole).for_each(|meaning| self.written.add(meaning));
        self.kept = kept;
        match put {
            Err(failure) if self.file.resume_full() => {
                if !std::mem::replace(&mut self.is_full, true) {
                    note(format_args!("{failure}; what finds no room is lost, until there is some"));
                }
                self.pending.drain(..).for_each(|meaning| self.unwritten.add_unwritten(meaning));
                self.full_until = Some(Instant::now() + TRY_AGAIN);
                Ok(())
            }
            put => {
                self.is_full &= whole == 0;
                put
            }
        }
    }

    /// Removes the oldest files of the series until the rest, with the present file at its full size, takes no more
    /// than it may. A file that another log writes or has just made stays, and so does a file that the log cannot open.
    fn remove_oldest(&mut self) {
        let Some(keep) = self.rotation.keep else { return };
        let Ok(files) = series(&self.path) else { return };
        // The last file that has rows.
        let last = self.previous.filter(|_| self.file.kept() == 0);
        let mut others: Vec<_> = files.into_iter().filter(|(number, ..)| *number != self.number).collect();
        others.sort_unstable_by_key(|(number, ..)| *number);
        let present = self.file.bytes().max(self.rotation.limit().unwrap_or_default());
        let mut bytes = others.iter().fold(present, |bytes, (_, _, taken)| bytes.saturating_add(*taken));
        for (number, path, taken) in others {
            if bytes <= keep || number > self.number {
                break;
            }
            if Some(number) == last || !opened(&path).is_ok_and(|file| !is_in_use(&file)) {
                continue;
            }
            match std::fs::remove_file(&path) {
                Ok(()) => bytes = bytes.saturating_sub(taken),
                Err(error) => {
                    note(format_args!("{}: {error}; it stays", path.display()));
                }
            }
        }
    }
}

/// Opens a file to look at its lock. Does not wait for a FIFO and does not follow a link: another program may have put
/// either there.
fn opened(path: &Path) -> io::Result<File> {
    let flags = OFlag::O_NONBLOCK | OFlag::O_NOFOLLOW;
    OpenOptions::new().read(true).custom_flags(flags.bits()).open(path)
}

/// Makes the file `number` of the series `path`, or the first later file that does not exist yet. Returns its number.
fn next(path: &Path, number: u64, fields: &[Field], stop: &Interrupt) -> Result<(u64, TableFile), Failure> {
    for number in number..=HIGHEST_NUMBER {
        if let Some(file) = TableFile::create_new(&place(path, number), fields, stop)? {
            return Ok((number, file));
        }
    }
    let name = path.display();
    Err(Failure::Request(format!("{name}: there is no number left for another file; log under another name")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{FieldKind, Table};

    fn fields() -> Vec<Field> {
        let names = ["update", "time_s", "unix_s", "missed", "lost", "1.actual_position"];
        names.map(|name| Field::new(name, "", FieldKind::Real)).into()
    }

    fn row(update: u64) -> [f64; 6] {
        [update as f64, 0.0, 0.0, 0.0, 0.0, 5.0]
    }

    #[test]
    fn the_files_of_a_series_are_numbered_on() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("log.csv");
        std::fs::write(directory.path().join("log-000041.csv"), "old").unwrap();
        std::fs::write(directory.path().join("log-x.csv"), "another").unwrap();
        let rotation = Rotation { bytes: Some(1), ..Rotation::default() };
        let mut files = Files::open(&path, fields(), rotation, &Interrupt::never()).unwrap();
        for update in 1..=3 {
            files.row(&row(update), RowMeaning::Update).unwrap();
            files.tended -= TEND;
            files.tend().unwrap();
        }
        files.finish().unwrap();
        assert_eq!((files.present(), place(&path, 45).exists()), (place(&path, 44), false));
        assert_eq!(files.tally(), Tally { updates: 3, missed: 0, lost: 0 });
        for (number, update) in [(42, 1.0), (43, 2.0), (44, 3.0)] {
            let table = Table::parse(&std::fs::read(place(&path, number)).unwrap()).unwrap();
            assert_eq!((table.rows(), table.columns[0][0]), (1, update));
        }
    }

    #[test]
    fn the_oldest_are_removed_and_no_other_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("log.npy");
        let stranger = directory.path().join("log-1.npy");
        std::fs::write(&stranger, vec![0; 10_000]).unwrap();
        for number in 1..=3 {
            std::fs::write(place(&path, number), vec![0; 1000]).unwrap();
        }
        let rotation = Rotation { keep: Some(3000), ..Rotation::default() };
        let mut files = Files::open(&path, fields(), rotation, &Interrupt::never()).unwrap();
        files.row(&row(1), RowMeaning::Update).unwrap();
        files.tended -= TEND;
        files.tend().unwrap();
        let left: Vec<_> = (1..=4).map(|number| place(&path, number).exists()).collect();
        assert_eq!((left, stranger.exists()), (vec![false, true, true, true], true));
    }

    #[test]
    fn no_file_of_somebody_elses_is_written_over_or_removed() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        let path = at("log.csv");
        let precious = [
            "log-20261126.csv",
            "log-18446744073709551615.csv",
            "log-0000001.csv",
            "log-+00001.csv",
            "log.csv",
            "target",
        ];
        precious.iter().for_each(|name| std::fs::write(at(name), vec![b'x'; 900_000]).unwrap());
        std::os::unix::fs::symlink(at("target"), at("log-000001.csv")).unwrap();
        nix::unistd::mkfifo(&at("log-000002.csv"), nix::sys::stat::Mode::S_IRWXU).unwrap();
        let rotation = Rotation { keep: Some(20_000), ..Rotation::default() };
        // Two logs with the same name.
        let open = || Files::open(&path, fields(), rotation, &Interrupt::never()).unwrap();
        let mut both = [open(), open()];
        for update in 0..3000 {
            both.iter_mut().for_each(|files| files.row(&row(update), RowMeaning::Update).unwrap());
            let present = both[1].present();
            assert!(present.exists() && present != both[0].present(), "row {update}: {present:?}");
        }
        both.iter_mut().for_each(|files| files.finish().unwrap());
        for name in precious {
            assert_eq!(std::fs::read(at(name)).unwrap().len(), 900_000, "{name}");
        }
    }

    #[test]
    fn in_a_directory_of_everybodys_only_ones_own_files_count() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("log.csv");
        let sparse = |number| {
            let file = File::create(place(&path, number)).unwrap();
            file.set_len(100 << 20).unwrap();
        };
        std::fs::write(place(&path, 1), vec![b'x'; 1000]).unwrap();
        // The test's own file, with a hole.
        sparse(2);
        let strange = [9_000_000, HIGHEST_NUMBER].map(|number| {
            sparse(number);
            let path = place(&path, number);
            // Only root can give a file away.
            let is_given = std::os::unix::fs::chown(&path, Some(12345), None).is_ok();
            if !is_given {
                std::fs::remove_file(&path).unwrap();
            }
            (is_given, path)
        });
        let linked = place(&path, 8_000_000);
        std::fs::write(directory.path().join("other"), "mine").unwrap();
        std::fs::hard_link(directory.path().join("other"), &linked).unwrap();
        let rotation = Rotation { keep: Some(20_000), ..Rotation::default() };
        let mut files = Files::open(&path, fields(), rotation, &Interrupt::never()).unwrap();
        files.row(&row(1), RowMeaning::Update).unwrap();
        files.finish().unwrap();
        assert_eq!(files.present(), place(&path, 3));
        assert!(place(&path, 1).exists() && place(&path, 2).exists() && linked.exists());
        assert!(strange.iter().all(|(is_given, path)| path.exists() == *is_given));
    }

    #[test]
    fn where_not_even_one_file_fits_the_last_rows_stay() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("log.csv");
        let rotation = Rotation { keep: Some(4), ..Rotation::default() };
        let mut files = Files::open(&path, fields(), rotation, &Interrupt::never()).unwrap();
        for update in 0..5 {
            files.row(&row(update), RowMeaning::Update).unwrap();
        }
        files.finish().unwrap();
        let left: Vec<u64> = series(&path).unwrap().into_iter().map(|(number, ..)| number).collect();
        assert_eq!((left, files.present()), (vec![5], place(&path, 5)));
    }

    #[test]
    fn all_files_take_no_more_than_they_may_at_any_time() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("log.csv");
        for rotate in [None, Some(5000), Some(1_000_000)] {
            let rotation = Rotation { bytes: rotate, keep: Some(20_000), ..Rotation::default() };
            let mut files = Files::open(&path, fields(), rotation, &Interrupt::never()).unwrap();
            for update in 0..3000 {
                files.row(&row(update), RowMeaning::Update).unwrap();
                let bytes: u64 = series(&path).unwrap().into_iter().map(|(_, _, taken)| taken).sum();
                assert!(bytes <= 20_000, "{rotate:?}, row {update}: {bytes}");
            }
            files.finish().unwrap();
            assert!(series(&path).unwrap().len() >= 3);
        }
    }

    #[test]
    fn a_recording_that_is_there_stays_until_there_is_a_row() {
        let directory = tempfile::tempdir().unwrap();
        for form in ["csv", "npy"] {
            let path = directory.path().join(format!("log.{form}"));
            std::fs::write(&path, "an old one").unwrap();
            let mut files = Files::open(&path, fields(), Rotation::default(), &Interrupt::never()).unwrap();
            let tended = |files: &mut Files| {
                files.tended -= TEND;
                files.tend().unwrap();
                std::fs::read(&path).unwrap()
            };
            assert_eq!(tended(&mut files), b"an old one", "{form}");
            files.finish().unwrap();
            files.discard();
            assert_eq!(tended(&mut files), b"an old one", "{form}");
            files.row(&row(1), RowMeaning::Update).unwrap();
            assert_ne!(tended(&mut files), b"an old one", "{form}");
        }
    }

    #[test]
    fn a_file_that_is_deleted_or_truncated_under_it_ends_the_log_within_a_second() {
        let directory = tempfile::tempdir().unwrap();
        let both = |form| ["deleted", "truncated"].map(|name| (form, name));
        for (form, name) in ["csv", "npy"].into_iter().flat_map(both) {
            let path = directory.path().join(format!("{name}.{form}"));
            let mut files = Files::open(&path, fields(), Rotation::default(), &Interrupt::never()).unwrap();
            let tend = |files: &mut Files| {
                files.tended -= TEND;
                files.tend()
            };
            files.row(&row(1), RowMeaning::Update).unwrap();
            tend(&mut files).unwrap();
            match name {
                "deleted" => std::fs::remove_file(&path).unwrap(),
                _ => OpenOptions::new().write(true).open(&path).unwrap().set_len(10).unwrap(),
            }
            // Whether another update comes or not.
            let failure = tend(&mut files).unwrap_err();
            assert!(matches!(failure, Failure::Refused(_)), "exit status 1: {failure:?}");
            let said = format!("{name}.{form}: another program {name} it while this one wrote it");
            assert!(failure.to_string().contains(&said), "{failure}");
            assert_eq!(files.tally().updates, 1);
        }
    }

    #[test]
    fn a_full_disk_costs_whole_rows_which_are_counted() {
        // The only file that is always full.
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("full.csv");
        std::os::unix::fs::symlink("/dev/full", &path).unwrap();
        let mut files = Files::open(&path, fields(), Rotation::default(), &Interrupt::never()).unwrap();
        for update in 0..2000 {
            let gap = Gap { missed: 2, ..Gap::default() };
            let meaning = if update == 7 { RowMeaning::Gap(gap) } else { RowMeaning::Update };
            files.row(&row(update), meaning).unwrap();
        }
        files.finish().unwrap();
        assert_eq!(files.tally(), Tally { updates: 0, missed: 2, lost: 1999 });
        assert_eq!(files.lost(), (0, 1999), "no row says where");
    }
}
