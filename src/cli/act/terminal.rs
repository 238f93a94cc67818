//! `pmacctl terminal`: sends lines to the board through the daemon, as you type them.
//!
//! A terminal has line editing and a history. The prompt shows the addressed motor and coordinate system. Messages of
//! the board's programs appear above the line being edited. In a pipe, lines come from stdin, replies go to stdout,
//! errors and messages to stderr.
//!
//! Other clients use the board, too. The terminal sends a line that depends on the address only while the user knows
//! the address: from the prompt, or, in a pipe, from the lines before. It sends a line for a program buffer that its
//! own lines have opened only while that buffer is open: otherwise the board would execute the line at once. No line
//! enters a buffer that another process has opened, not even a process of the same user.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use clap::Args;
use nix::unistd::getuid;
use rustyline::config::Configurer;
use rustyline::error::ReadlineError;
use rustyline::{DefaultEditor, ExternalPrinter};
use serde_json::json;

use crate::cli::act::address::Addressed;
use crate::cli::act::control_keys::{ControlKeys, Pressed};
use crate::cli::act::lines::{LineError, entered_note};
use crate::cli::act::piped;
use crate::cli::act::reset_watch::ResetWatch;
use crate::cli::args::values::line_timeout;
use crate::cli::console::note;
use crate::cli::console::output::reply;
use crate::cli::context::{Context, Failure, Verdict};
use crate::client::{CommandError, Connection, Messages, OwnBuffer};
use crate::language::Meaning;
use crate::protocol::board::SendReply;
use crate::protocol::{CallError, Message, MessageKind, OpenBufferInfo, check_line, control};

/// Time limit for the question for the address.
const ADDRESS: Duration = Duration::from_millis(500);
/// How long the daemon may take to learn that a buffer is closed.
const CLOSING: Duration = Duration::from_millis(50);
/// How often the message thread checks whether to end.
const MESSAGE_WITHIN: Duration = Duration::from_millis(200);
/// Length of the history, in lines.
const HISTORY: usize = 1000;
const HELP: &str = "\
A line goes to the board as it is. ^K (two characters) sends a control character, which overtakes lines that wait:
^A aborts, ^K kills. These two are also keys, on an empty line. .quit or the end of input leaves.";

/// `terminal`.
#[derive(Debug, Args)]
pub struct Terminal {
    /// Time limit of a line, in seconds; slow lines such as SAVE have longer limits
    #[arg(long, value_name = "S", default_value = "10", value_parser = line_timeout, allow_negative_numbers = true)]
    pub timeout: Duration,
    /// Do not write the history to disk
    #[arg(long)]
    pub no_history: bool,
    /// Print control characters from the board unchanged, not as \x1b
    #[arg(long)]
    pub raw: bool,
    /// Also send lines that pmacd refuses otherwise: ^Z and I58=0, which end command lines for everybody; $$$ and SAVE
    /// while other users' work runs
    #[arg(long)]
    pub yes: bool,
}

pub fn run(context: &mut Context, options: &Terminal) -> Result<Verdict, Failure> {
    let session = Session::new(context.connection()?.confirming(options.yes), options.timeout);
    let messages = context.connection()?.messages()?;
    if io::stdin().is_terminal() && io::stdout().is_terminal() && !context.output.is_json() {
        interactive(session, messages, options)
    } else {
        piped(context, session, messages, options.raw)
    }
}

/// A typed line, parsed.
#[derive(Debug, PartialEq, Eq)]
enum Input<'a> {
    Nothing,
    Quit,
    Help,
    Control(u8),
    Line(&'a str),
    Wrong(String),
}

impl<'a> Input<'a> {
    fn of(text: &'a str) -> Self {
        // White space does not include the control characters: some are commands.
        let text = text.trim_matches([' ', '\t', '\r']);
        match text {
            "" => Self::Nothing,
            ".quit" | ".exit" | ".q" => Self::Quit,
            ".help" | ".h" => Self::Help,
            _ if text.starts_with('.') && !text[1..].starts_with(|c: char| c.is_ascii_digit()) => {
                Self::Wrong(format!("{text}: unknown; .help lists the commands"))
            }
            _ => match control::parse(text).filter(|_| text.len() <= 2 && text != "\t") {
                Some(character) => Self::Control(character),
                None => match check_line(text) {
                    Ok(()) => Self::Line(text),
                    Err(reason) => Self::Wrong(format!("not sent: {reason}")),
                },
            },
        }
    }
}

struct Session {
    connection: Connection,
    timeout: Duration,
    all_taken: bool,
    /// The address as the user knows it.
    addressed: Option<Addressed>,
    /// The program buffer that these lines have opened.
    own_buffer: OwnBuffer,
    /// The program buffer that the last line may have entered, although the line is no program statement.
    entered: Option<OpenBufferInfo>,
}

/// The reply lines, and the error that ended the reply.
type LineAnswer = (Vec<String>, Option<String>, Option<u16>);

impl Session {
    fn new(connection: Connection, timeout: Duration) -> Self {
        let own_buffer = OwnBuffer::default();
        Self { connection, timeout, all_taken: true, addressed: None, own_buffer, entered: None }
    }

    /// The board's reply to a line or control character.
    ///
    /// # Errors
    /// The daemon or the board can no longer be reached.
    fn ask(&mut self, input: &Input<'_>) -> Result<LineAnswer, Failure> {
        let result = match input {
            Input::Control(character) => {
                self.own_buffer.control(&mut self.connection, *character).map_err(LineError::from)
            }
            Input::Line(line) => self.send(line),
            _ => Ok(Vec::new()),
        };
        self.all_taken &= result.is_ok();
        if let (Input::Line(line), Ok(_)) = (input, &result)
            && line.contains(['#', '&', '$'])
        {
            self.addressed = self.address();
        }
        match result {
            Ok(lines) => Ok((lines, None, None)),
            Err(mut error) => {
                let lines = error.take_lines();
                match error {
                    LineError::Board { code, text, .. } => Ok((lines, Some(text), code)),
                    error => match error.into() {
                        // The next line may succeed.
                        Failure::Refused(text) => Ok((lines, Some(text), None)),
                        failure => Err(failure),
                    },
                }
            }
        }
    }

    /// Sends a line, if the board would do with it what the user means.
    fn send(&mut self, line: &str) -> Result<Vec<String>, LineError> {
        // A program statement does not depend on the address.
        let meaning = Meaning::of(line);
        let is_stored = self.own_buffer.is_open() && meaning.while_open.enters;
        if let Some(known) = self.addressed.filter(|_| !is_stored && meaning.goes_by_address)
            && let Some(now) = self.address().filter(|now| *now != known)
        {
            let why = format!(
                "not sent: somebody else has addressed {now} meanwhile; write into the line what it is for, as in {known} {line}"
            );
            return Err(LineError::NotSent(Failure::Refused(why)));
        }
        let timeout = meaning.deadline(self.timeout);
        match self.own_buffer.send_and_see(&mut self.connection, line, timeout) {
            // The board need not acknowledge a reset.
            Err(CommandError::Refused(CallError::TimedOut { .. })) if meaning.resets => Ok(Vec::new()),
            sent => {
                let SendReply { lines, entered } = sent?;
                // For a statement, the prompt or the line that opened the buffer already says so.
                self.entered = entered.filter(|_| meaning.while_open.may_act);
                Ok(lines)
            }
        }
    }

    /// The address, if the board answers in time.
    fn address(&mut self) -> Option<Addressed> {
        Addressed::of(&self.connection.question(Addressed::QUESTION, ADDRESS).ok()?)
    }

    /// Reports a reset of the board, after a sent line or at the end.
    fn see_reset(&mut self, watch: &mut ResetWatch, line: Option<&str>) {
        if let Some(reset) = match line {
            Some(line) => watch.line_sent(line, &mut self.connection),
            None => watch.look(&mut self.connection),
        } {
            self.all_taken = false;
            note(reset);
        }
    }

    /// The prompt: the address, and the open program buffer. Reports another client's change of the address.
    fn prompt(&mut self) -> io::Result<String> {
        let open = self.open_buffer();
        let (before, now) = (self.addressed, self.address());
        if let Some((before, now)) = before.zip(now).filter(|(before, now)| before != now) {
            println(&format!("-- somebody else has addressed {now}; it was {before}"))?;
        }
        self.addressed = now;
        let addressed = self.addressed.map_or_else(|| "pmac".to_owned(), |addressed| addressed.to_string());
        Ok(match open {
            Some(open) if self.own_buffer.is_open() && open.takes_lines_of(getuid().as_raw()) => {
                format!("{addressed} {}> ", open.name())
            }
            Some(open) => format!("{addressed} ({open})> "),
            None => format!("{addressed}> "),
        })
    }

    /// The open program buffer, as far as the daemon knows.
    fn open_buffer(&mut self) -> Option<OpenBufferInfo> {
        self.connection.info().ok()?.open_buffer
    }

    /// Prints the [`entered_note`] on the last line.
    fn tell_entered(&mut self, line: &str) {
        if let Some(open) = self.entered.take() {
            note(entered_note(line.trim(), &open));
        }
    }

    /// At the end: reports a buffer that is still open and takes this user's lines.
    fn tell_left_open(&mut self) {
        let mut own = || self.open_buffer().filter(|open| open.takes_lines_of(getuid().as_raw()));
        if own().is_none() {
            return;
        }
        // The daemon may only now be learning of a CLOSE that was the last line.
        std::thread::sleep(CLOSING);
        if let Some(open) = own() {
            note(format_args!(
                "{} is still open: lines that you send enter it, others' are refused; CLOSE closes it",
                open.name()
            ));
        }
    }
}

fn interactive(mut session: Session, messages: Messages, options: &Terminal) -> Result<Verdict, Failure> {
    let failed = |error: ReadlineError| Failure::Request(format!("the terminal: {error}"));
    let mut editor = DefaultEditor::new().map_err(failed)?;
    editor.set_max_history_size(HISTORY).map_err(failed)?;
    let history = if options.no_history { None } else { history_file() };
    if let Some(file) = &history {
        // The first session has no history to load.
        let _ = editor.load_history(file);
    }
    let keys = ControlKeys::bind(&mut editor);
    let mut printer = editor.create_external_printer().map_err(failed)?;
    let raw = options.raw;
    let listening = Listening::begin(messages, move |text| {
        let _ = printer.print(format!("{}\n", reply(&text, raw)));
    });
    println(".help lists the commands, .quit ends.")?;
    let mut line = (String::new(), String::new());
    let outcome = loop {
        let prompt = session.prompt()?;
        let edited = editor.readline_with_initial(&prompt, (&line.0, &line.1));
        line = Default::default();
        let text = match edited {
            Ok(text) => text,
            Err(ReadlineError::Interrupted) => match keys.take() {
                Some(Pressed { character, line: (before, behind) })
                    if before.is_empty() && behind.is_empty() =>
                {
                    control::name(character)
                }
                Some(pressed) => {
                    let name = control::name(pressed.character);
                    println(&format!("{name}: not sent, because a line is begun; ^C drops it"))?;
                    line = pressed.line;
                    continue;
                }
                // ^C drops the line, as in a shell.
                None => continue,
            },
            Err(ReadlineError::Eof) => break Ok(()),
            Err(error) => break Err(failed(error)),
        };
        if !Meaning::of(&text).has_password {
            let _ = editor.add_history_entry(&text);
        }
        match answer(&mut session, &text, raw) {
            Ok(true) => {}
            Ok(false) => break Ok(()),
            Err(failure) => break Err(failure),
        }
    };
    drop(listening);
    session.tell_left_open();
    if let Some(file) = &history {
        save_history(&mut editor, file);
    }
    outcome.map(|()| Verdict::Yes)
}

/// Executes typed or pasted text of one or more lines. Returns whether to go on.
fn answer(session: &mut Session, text: &str, raw: bool) -> Result<bool, Failure> {
    for text in text.lines() {
        let input = Input::of(text);
        match &input {
            Input::Nothing => {}
            Input::Quit => return Ok(false),
            Input::Help => println(HELP)?,
            Input::Wrong(what) => println(what)?,
            Input::Control(_) | Input::Line(_) => {
                let (lines, error, _) = session.ask(&input)?;
                session.tell_entered(text);
                for line in lines.iter().chain(&error) {
                    println(&reply(line, raw))?;
                }
                if let (Input::Control(character), [], None) = (&input, &lines[..], &error) {
                    println(&format!("{} sent", control::name(*character)))?;
                }
            }
        }
    }
    Ok(true)
}

/// `println!` would panic on a closed pipe.
fn println(text: &str) -> io::Result<()> {
    writeln!(io::stdout(), "{text}")
}

/// The directory for state files (XDG base directories).
fn history_file() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let state =
        absolute("XDG_STATE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".local/state")))?;
    Some(state.join("pmacctl/history"))
}

fn save_history(editor: &mut DefaultEditor, file: &std::path::Path) {
    let saved = file
        .parent()
        .map_or(Ok(()), std::fs::create_dir_all)
        .map_err(ReadlineError::from)
        .and_then(|()| editor.save_history(file));
    if let Err(error) = saved {
        note(format_args!("{}: the history was not saved: {error}", file.display()));
    }
}

fn piped(
    context: &mut Context,
    mut session: Session,
    messages: Messages,
    raw: bool,
) -> Result<Verdict, Failure> {
    let listening = Listening::begin(messages, move |text| {
        note(reply(&text, raw));
    });
    let mut watch = ResetWatch::begin(&mut session.connection);
    for text in piped::lines() {
        let text = text?;
        let input = Input::of(&text);
        let (lines, error, code) = match &input {
            Input::Nothing => continue,
            Input::Quit => break,
            Input::Help => (vec![HELP.to_owned()], None, None),
            Input::Wrong(what) => {
                session.all_taken = false;
                (Vec::new(), Some(what.clone()), None)
            }
            Input::Control(_) | Input::Line(_) => {
                let answer = session.ask(&input)?;
                session.see_reset(&mut watch, Some(&text));
                session.tell_entered(&text);
                answer
            }
        };
        if context.output.is_json() {
            let error = error.map(|message| json!({ "code": code, "message": message }));
            context.output.json_line(&json!({ "line": text.trim(), "lines": lines, "error": error }))?;
            context.output.flush()?;
            continue;
        }
        for line in lines {
            context.output.reply(&line, raw)?;
        }
        // Flush, so that a reader of both streams sees them in order.
        context.output.flush()?;
        if let Some(error) = error {
            note(reply(&error, raw));
        }
    }
    session.see_reset(&mut watch, None);
    session.tell_left_open();
    drop(listening);
    Ok(session.all_taken.into())
}

/// The thread that waits for messages of the board's programs. The thread ends on drop.
struct Listening {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Listening {
    fn begin(mut messages: Messages, mut tell: impl FnMut(String) + Send + 'static) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let thread = std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                match messages.next_within(MESSAGE_WITHIN) {
                    Ok(Some(message)) => tell(shown(&message)),
                    Ok(None) if messages.ended() => {
                        return tell("-- no more messages: pmacd has stopped".to_owned());
                    }
                    Ok(None) => {}
                    Err(error) => return tell(format!("-- no more messages: {error}")),
                }
            }
        });
        Self { end, thread: Some(thread) }
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been printed already.
            let _ = thread.join();
        }
    }
}

/// A message from the board's programs, with its mark.
fn shown(message: &Message) -> String {
    let kind = match message.kind {
        MessageKind::Cmd => "CMD",
        MessageKind::Send => "SEND",
        MessageKind::Error => "error of a program",
    };
    let lost = if message.lost > 0 {
        format!(" ({} earlier messages were lost)", message.lost)
    } else {
        String::new()
    };
    format!("-- {kind}: {}{lost}", message.text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_typed_is_understood() {
        assert_eq!(Input::of("  "), Input::Nothing);
        assert_eq!(Input::of(" .quit "), Input::Quit);
        assert_eq!(Input::of("^k"), Input::Control(11));
        assert_eq!(Input::of("\u{b}"), Input::Control(11), "the character itself, which is white space");
        assert_eq!(Input::of(" \u{1} "), Input::Control(1));
        assert!(matches!(Input::of("P1\u{b}"), Input::Wrong(what) if what.contains("not sent")));
        assert_eq!(Input::of(" #1J+ "), Input::Line("#1J+"));
        assert_eq!(Input::of("J^100"), Input::Line("J^100"));
        assert_eq!(Input::of(".5"), Input::Line(".5"));
        assert!(matches!(Input::of(".wrong"), Input::Wrong(what) if what.contains(".help")));
        assert!(matches!(Input::of("\u{fc}"), Input::Wrong(_)));
        assert!(matches!(Input::of(&"x".repeat(201)), Input::Wrong(_)));
    }

    #[test]
    fn texts_are_marked() {
        let message = |kind, lost| Message { time_ns: 0, kind, text: "HI".to_owned(), lost };
        assert_eq!(shown(&message(MessageKind::Send, 0)), "-- SEND: HI");
        assert_eq!(shown(&message(MessageKind::Cmd, 2)), "-- CMD: HI (2 earlier messages were lost)");
    }
}
