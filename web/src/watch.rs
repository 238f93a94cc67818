//! The variables that the command line names: one thread asks the board for them once a second, however many pages show
//! them.

use std::io;
use std::thread;
use std::time::{Duration, Instant};

use pmac_dpram::client::command::variables::board_variable;
use serde_json::{Value, json};
use tokio::sync::watch;

use crate::board::Place;

/// How often the thread asks.
const EVERY: Duration = Duration::from_secs(1);
/// How long the board may take for an answer.
const WITHIN: Duration = Duration::from_secs(2);
/// Answers of this age are old: the board or the daemon is late.
const OLD: Duration = Duration::from_secs(4);

/// The name of a variable that this program may ask for, as `P1`.
///
/// # Errors
/// The text names no such variable.
pub fn variable(text: &str) -> Result<String, String> {
    match board_variable(text) {
        Some(name) if !name.starts_with('M') => Ok(name),
        Some(_) => {
            Err("M-variables can be registers of the hardware; name the word in a [[user]] table".to_owned())
        }
        None => Err("write I-, P- and Q-variables as P1,Q5,I122".to_owned()),
    }
}

/// The variables, and the board's last answers.
#[derive(Debug, Clone)]
pub struct Watched {
    names: Vec<String>,
    answers: Result<Vec<String>, String>,
    at: Instant,
}

impl Watched {
    /// As JSON: no value of an old answer, and why.
    #[must_use]
    pub fn document(&self) -> Value {
        let age = self.at.elapsed();
        let why = match &self.answers {
            Ok(_) if self.names.is_empty() || age < OLD => None,
            Ok(_) => Some(format!("no answer for {} s", age.as_secs())),
            Err(why) => Some(why.clone()),
        };
        let answers = self.answers.as_deref().ok().filter(|_| why.is_none());
        let values = self.names.iter().enumerate().map(
            |(index, name)| json!({ "name": name, "value": answers.and_then(|answers| answers.get(index)) }),
        );
        json!({ "values": values.collect::<Vec<_>>(), "reason": why })
    }
}

/// Starts the thread, if there are `names`.
///
/// # Errors
/// The system starts no thread.
pub fn start(place: Place, names: Vec<String>) -> io::Result<watch::Receiver<Watched>> {
    let none_yet =
        if names.is_empty() { Ok(Vec::new()) } else { Err("the board has not answered yet".to_owned()) };
    let first = Watched { names, answers: none_yet, at: Instant::now() };
    let (sender, watched) = watch::channel(first);
    if !sender.borrow().names.is_empty() {
        thread::Builder::new().name("watch".to_owned()).spawn(move || follow(&place, &sender))?;
    }
    Ok(watched)
}

fn follow(place: &Place, sender: &watch::Sender<Watched>) {
    let names = sender.borrow().names.clone();
    while !sender.is_closed() {
        let answers = ask(place, &names);
        sender.send_modify(|watched| (watched.answers, watched.at) = (answers, Instant::now()));
        thread::sleep(EVERY);
    }
}

fn ask(place: &Place, names: &[String]) -> Result<Vec<String>, String> {
    let mut board = place.attach().map_err(|error| error.to_string())?;
    let connection = board.connection().map_err(|error| error.to_string())?;
    connection.ask_variables(names, WITHIN).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_variables_that_an_observer_may_ask_for_are_watched() {
        for (text, name) in [("p1", "P1"), ("Q5", "Q5"), ("i122", "I122")] {
            assert_eq!(variable(text).unwrap(), name);
        }
        for wrong in ["M1", "m102", "P1=5", "X:$28", "1.velocity", "^K", "&1", "P", ""] {
            assert!(variable(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn without_names_nothing_is_missing() {
        let at = Instant::now().checked_sub(OLD).unwrap();
        let none = Watched { names: Vec::new(), answers: Ok(Vec::new()), at }.document();
        assert_eq!(none, json!({ "values": [], "reason": null }));
    }

    #[test]
    fn an_old_answer_and_a_refusal_have_no_values_and_a_reason() {
        let names = vec!["P1".to_owned()];
        let watched = |answers, at| Watched { names: names.clone(), answers, at }.document();
        let fresh = watched(Ok(vec!["5".to_owned()]), Instant::now());
        assert_eq!(fresh, json!({ "values": [{ "name": "P1", "value": "5" }], "reason": null }));
        for (answers, ago) in [(Ok(vec!["5".to_owned()]), OLD), (Err("refused".to_owned()), Duration::ZERO)] {
            let old = watched(answers, Instant::now().checked_sub(ago).unwrap());
            assert_eq!(old["values"], json!([{ "name": "P1", "value": null }]));
            assert!(old["reason"].is_string(), "{old}");
        }
    }
}
