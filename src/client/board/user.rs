//! The site's own words, which its programs write into the DPRAM, by the names of the daemon's configuration.
//!
//! Names, formats and units come from the segment, so a reader needs neither the configuration nor the socket.

use serde_json::{Value as Json, json};

use super::{Board, ClientError, History, Reading};
use crate::client::view::View;
use crate::decode::{Value, user::values};
use crate::map::Family;
pub use crate::map::user_word::UserWord;
use crate::segment::payload::user;
use crate::segment::{RegionId, RegionInfo, SegmentError};

/// The site's words at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct UserData {
    /// All words, in the order of the configuration.
    pub words: Vec<UserValues>,
}

/// One name and its values.
#[derive(Debug, Clone, PartialEq)]
pub struct UserValues {
    /// The name, with its place and its format.
    pub word: UserWord,
    /// The values; `None` if the board was writing them each time the daemon read.
    pub values: Option<Vec<Value>>,
}

impl UserValues {
    /// As JSON: name, value or values, unit and place.
    #[must_use]
    pub fn document(&self, family: &Family) -> Json {
        let Self { word, values } = self;
        let value = match values.as_deref() {
            None => Json::Null,
            Some([one]) if word.count == 1 => json!(one),
            Some(all) => json!(all),
        };
        json!({
            "name": &word.name[..],
            "value": value,
            "unit": if word.unit.is_empty() { Json::Null } else { json!(&word.unit[..]) },
            "address": word.location.pmac_address(family).to_string(),
            "bits": word.bits,
        })
    }
}

impl UserData {
    /// The word called `name`.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&UserValues> {
        self.words.iter().find(|values| *values.word.name == *name)
    }
}

impl Board {
    /// The site's own words; `None` before the first sample, or if the configuration names no words.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn user(&mut self) -> Result<Option<View<UserData>>, ClientError> {
        let condition = self.refresh()?;
        let reading = self.read_user()?;
        self.judged(&super::Moment::now(&self.subscriber, condition), RegionId::User, reading)
    }

    /// The words' names, places and units; empty if the configuration names no words.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn user_words(&mut self) -> Result<Vec<UserWord>, ClientError> {
        self.refresh()?;
        Ok(self.table()?.unwrap_or_default())
    }

    /// Samples of the words from number `since` on, at most `most`, as [`Board::history`]; empty if the configuration
    /// names no words.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn user_history(&mut self, since: u64, most: usize) -> Result<History<UserData>, ClientError> {
        let condition = self.refresh()?;
        let Some(words) = self.table()? else {
            return Ok(History { samples: Vec::new(), lost: 0, next: since });
        };
        let cursor = self.subscriber.cursor(RegionId::User, since)?;
        self.follow(cursor, most, condition, |region, payload| decode(&words, region, payload))
    }

    /// Copies and decodes the latest sample.
    pub(super) fn read_user(&mut self) -> Result<Option<Reading<UserData>>, ClientError> {
        let Some(words) = self.table()? else { return Ok(None) };
        self.read(RegionId::User, |region, payload| decode(&words, region, payload))
    }

    /// The words of the configuration; decoded once for each segment.
    fn table(&mut self) -> Result<Option<Vec<UserWord>>, ClientError> {
        let generation = self.subscriber.generation();
        let words = match self.user_words.take().filter(|(known, _)| *known == generation) {
            Some((_, words)) => words,
            None => match self.latest(RegionId::UserTable)? {
                Some(sequence) => user::decode_table(self.sample.bytes())
                    .ok_or(SegmentError::Corrupt { region: RegionId::UserTable, sequence })?,
                None => return Ok(None),
            },
        };
        self.user_words = Some((generation, words.clone()));
        Ok(Some(words))
    }
}

fn decode(words: &[UserWord], region: &RegionInfo, payload: &[u16]) -> Result<UserData, ClientError> {
    let corrupt = SegmentError::Corrupt { region: region.id, sequence: region.published };
    let split = user::split(words, payload).ok_or(corrupt)?;
    let words = words
        .iter()
        .zip(split)
        .map(|(word, words)| UserValues { word: *word, values: words.map(|words| values(word, words)) });
    Ok(UserData { words: words.collect() })
}
