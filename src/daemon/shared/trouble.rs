//! A trouble that comes again and again, and that the log gets once.

use std::fmt::Display;

use log::{Level, log};

/// The log's last entry on the trouble, while the trouble lasts.
#[derive(Debug, Default)]
pub struct Trouble(Option<String>);

impl Trouble {
    /// Logs the `result` of an attempt made every second, if it differs from the last attempt's.
    pub fn note(&mut self, result: Result<(), impl Display>) {
        if let Some((level, text)) = self.change(result.err().map(|error| error.to_string())) {
            log!(level, "{text}");
        }
    }

    fn change(&mut self, trouble: Option<String>) -> Option<(Level, String)> {
        let before = std::mem::replace(&mut self.0, trouble);
        match (&self.0, before) {
            (now, before) if *now == before => None,
            (Some(now), _) => Some((Level::Warn, format!("{now}; pmacd tries again every second"))),
            (None, before) => before.map(|before| (Level::Info, format!("no more: {before}"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lasts_is_told_once_and_its_end_too() {
        let mut trouble = Trouble::default();
        let results = [None, Some("a"), Some("a"), Some("b"), None, None];
        let told = results.map(|result| trouble.change(result.map(str::to_owned)).map(|(_, text)| text));
        let told: Vec<&str> = told.iter().flatten().map(String::as_str).collect();
        let again = "pmacd tries again every second";
        assert_eq!(told, [format!("a; {again}"), format!("b; {again}"), "no more: b".to_owned()]);
    }
}
