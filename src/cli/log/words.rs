//! The site's own words, in columns behind the motors'.

use std::collections::VecDeque;

use crate::cli::context::Failure;
use crate::client::{Board, ClientError, UserData, View};
use crate::segment::RegionId;
use crate::table::{Field, FieldKind};

/// Stands before a word's name in `--fields` and in its columns.
pub const PREFIX: &str = "user.";

/// One value of each row.
#[derive(Debug, Clone)]
struct Column {
    name: String,
    /// The place of the value among the word's values.
    index: usize,
    field: Field,
}

/// The words at each update: the values that `pmacd` had last read before it.
pub struct Words {
    columns: Vec<Column>,
    /// The value in the log's trigger.
    trigger: Option<Column>,
    /// The latest sample that is no newer than the last update, and all later samples.
    samples: VecDeque<View<UserData>>,
    /// The generation of the samples' segment, and the next sample's number.
    generation: u64,
    next: u64,
    /// The age at which a sample is too old.
    stale_after_ns: u64,
}

impl Words {
    /// All words, or the words in `fields`; and the value whose column would be called `trigger`.
    ///
    /// # Errors
    /// [`Failure::Request`] for a name that the configuration does not have.
    pub fn new(board: &mut Board, fields: &[String], trigger: Option<&str>) -> Result<Self, Failure> {
        let words = board.user_words()?;
        let named: Vec<&str> = fields.iter().filter_map(|field| field.strip_prefix(PREFIX)).collect();
        if let Some(unknown) = named.iter().find(|name| words.iter().all(|word| word.name[..] != ***name)) {
            let names: Vec<&str> = words.iter().map(|word| &word.name[..]).collect();
            return Err(Failure::Request(format!(
                "no [[user]] is called {unknown:?}; there are: {}",
                names.join(", ")
            )));
        }
        let all = words.iter().flat_map(|word| {
            (0..word.count).map(|index| {
                let name = word.name.to_string();
                let place = if word.count == 1 { String::new() } else { format!("[{}]", index + 1) };
                let field = Field::new(format!("{PREFIX}{name}{place}"), &word.unit[..], FieldKind::Real);
                Column { name, index, field }
            })
        });
        let all: Vec<Column> = all.collect();
        let is_triggers = |column: &&Column| trigger == Some(&column.field.name);
        let of_trigger = all.iter().find(is_triggers).cloned();
        if let (Some(unknown), None) = (trigger, &of_trigger) {
            let names: Vec<&str> = all.iter().map(|column| &*column.field.name).collect();
            return Err(Failure::Request(format!(
                "--trigger: there is no {unknown:?}, but: {}",
                names.join(", ")
            )));
        }
        let is_wanted = |column: &Column| fields.is_empty() || named.contains(&&*column.name);
        let columns = all.into_iter().filter(is_wanted).collect();
        let published = board.subscriber().published(RegionId::User).unwrap_or(0);
        let generation = board.subscriber().generation();
        Ok(Self {
            columns,
            trigger: of_trigger,
            samples: VecDeque::new(),
            generation,
            next: published,
            stale_after_ns: 0,
        })
    }

    /// The columns.
    pub fn fields(&self) -> impl Iterator<Item = &Field> {
        self.columns.iter().map(|column| &column.field)
    }

    /// Takes the new samples. Call this after taking updates: then the samples of these updates are here.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn advance(&mut self, board: &mut Board) -> Result<(), ClientError> {
        if self.columns.is_empty() && self.trigger.is_none() {
            return Ok(());
        }
        let generation = board.subscriber().generation();
        if generation != self.generation {
            (self.generation, self.next) = (generation, 1);
            self.samples.clear();
        }
        let history = board.user_history(self.next, usize::MAX)?;
        self.next = history.next;
        self.samples.extend(history.samples);
        self.stale_after_ns =
            board.subscriber().region(RegionId::User).map_or(0, |region| region.stale_after_ns);
        Ok(())
    }

    /// The values at an update of `time_ns`; call this in the order of the updates. NaN for a word that was not whole,
    /// or is old.
    pub fn at(&mut self, time_ns: u64) -> impl Iterator<Item = f64> {
        self.advance_to(time_ns);
        let this = &*self;
        this.columns.iter().map(move |column| this.value(column, time_ns))
    }

    /// The value in the log's trigger, as [`Self::at`] has it.
    pub fn of_trigger(&mut self, time_ns: u64) -> f64 {
        self.advance_to(time_ns);
        self.trigger.as_ref().map_or(f64::NAN, |column| self.value(column, time_ns))
    }

    /// Drops the samples that are older than the latest one at `time_ns`.
    fn advance_to(&mut self, time_ns: u64) {
        while self.samples.get(1).is_some_and(|sample| sample.time_ns <= time_ns) {
            self.samples.pop_front();
        }
    }

    fn value(&self, column: &Column, time_ns: u64) -> f64 {
        let is_live = |sample: &&View<UserData>| {
            sample.time_ns <= time_ns && time_ns - sample.time_ns <= self.stale_after_ns
        };
        let sample = self.samples.front().filter(is_live);
        let values = sample.and_then(|sample| sample.data.get(&column.name)?.values.as_ref());
        values.and_then(|values| values.get(column.index)).map_or(f64::NAN, |value| value.number())
    }
}
