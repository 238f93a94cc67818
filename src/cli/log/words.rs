//! The site's own words, in columns behind the motors'.

use std::collections::VecDeque;

use crate::cli::context::Failure;
use crate::client::{Board, ClientError, UserData, View};
use crate::segment::RegionId;
use crate::table::{Field, FieldKind};

/// Stands before a word's name in `--fields` and in its columns.
pub const PREFIX: &str = "user.";

/// One value of each row.
struct Column {
    name: String,
    /// The place of the value among the word's values.
    index: usize,
    field: Field,
}

/// The words at each update: the values that `pmacd` had last read before it.
pub struct Words {
    columns: Vec<Column>,
    /// The latest sample that is no newer than the last update, and all later samples.
    samples: VecDeque<View<UserData>>,
    /// The generation of the samples' segment, and the next sample's number.
    generation: u64,
    next: u64,
    /// The age at which a sample is too old.
    stale_after_ns: u64,
}

impl Words {
    /// All words, or the words in `fields`.
    ///
    /// # Errors
    /// [`Failure::Request`] for a name that the configuration does not have.
    pub fn new(board: &mut Board, fields: &[String]) -> Result<Self, Failure> {
        let words = board.user_words()?;
        let named: Vec<&str> = fields.iter().filter_map(|field| field.strip_prefix(PREFIX)).collect();
        if let Some(unknown) = named.iter().find(|name| words.iter().all(|word| word.name[..] != ***name)) {
            let names: Vec<&str> = words.iter().map(|word| &word.name[..]).collect();
            return Err(Failure::Request(format!(
                "no [[user]] is called {unknown:?}; there are: {}",
                names.join(", ")
            )));
        }
        let wanted = words.iter().filter(|word| fields.is_empty() || named.contains(&&word.name[..]));
        let columns = wanted.flat_map(|word| {
            (0..word.count).map(|index| {
                let name = word.name.to_string();
                let place = if word.count == 1 { String::new() } else { format!("[{}]", index + 1) };
                let field = Field::new(format!("{PREFIX}{name}{place}"), &word.unit[..], FieldKind::Real);
                Column { name, index, field }
            })
        });
        let columns = columns.collect();
        let published = board.subscriber().published(RegionId::User).unwrap_or(0);
        let generation = board.subscriber().generation();
        Ok(Self { columns, samples: VecDeque::new(), generation, next: published, stale_after_ns: 0 })
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
        if self.columns.is_empty() {
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
        while self.samples.get(1).is_some_and(|sample| sample.time_ns <= time_ns) {
            self.samples.pop_front();
        }
        let Self { columns, samples, stale_after_ns, .. } = self;
        let is_live = |sample: &&View<UserData>| {
            sample.time_ns <= time_ns && time_ns - sample.time_ns <= *stale_after_ns
        };
        let sample = samples.front().filter(is_live);
        columns.iter().map(move |Column { name, index, .. }| {
            let values = sample.and_then(|sample| sample.data.get(name)?.values.as_ref());
            values.and_then(|values| values.get(*index)).map_or(f64::NAN, |value| value.number())
        })
    }
}
