//! `pmacctl rotary check`: sends a few program lines as binary commands, has the board list them, and compares.
//!
//! No program runs: the command takes the lines out of the board's rotary buffer again. The manual's drawing has the
//! code of ABS, INC and FRAX in two places. A board with the other place would take an INC for an ABS and move
//! elsewhere. The board's listing shows how the board would act.

use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;

use super::source::{Format, NOTHING_TAKEN, circle_warning, compiled};
use super::stream::{check_system, own_buffer};
use crate::cli::args::values::number;
use crate::cli::console::note;
use crate::cli::context::{Context, Failure, Verdict};
use crate::client::{Connection, RotaryFeed, RotaryPlace};
use crate::map::DEFAULT_FAMILY;
use crate::map::readings::RotaryCode2;
use crate::preprocess::shown;
use crate::rotary::{Item, Line, Program, Settings, compile, decompile};

/// The commands whose code may be in two places, and others of each kind.
const SAMPLE: &[u8] = b"ABS(X)\nINC(X,Y)\nFRAX(X,Y)\nM1|=6\nLINEAR\nX10 Y-2.5\nDWELL100\n";
/// If HOME can name more motors than PMAC has, the code for them is worked out.
const MORE_MOTORS: &[u8] = b"HOME9,24\n";
/// Time limit of a command line.
const LINE_PATIENCE: Duration = Duration::from_secs(5);
/// How long the board may take for all lines.
const TAKEN_WITHIN: Duration = Duration::from_secs(3);
/// How often to check whether the board has taken all lines.
const ASK_STATE_EVERY: Duration = Duration::from_millis(20);

/// `rotary check`.
#[derive(Debug, Args)]
pub struct Check {
    /// The program's text, constants only; - is stdin. Without it, the commands whose code may stand in two places, and
    /// some others
    #[arg(value_name = "FILE")]
    pub file: Option<String>,
    /// The coordinate system whose rotary buffer takes the lines. It must not run
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = number)]
    pub cs: u8,
    /// First define a rotary buffer of this many words in the board's own memory (DEFINE ROT), as for stream
    #[arg(long, value_name = "LONGS")]
    pub define: Option<u32>,
    #[command(flatten)]
    pub format: Format,
}

pub fn run(context: &mut Context, options: &Check) -> Result<Verdict, Failure> {
    let mut board = context.connection()?;
    let family = Context::family(None, &mut board)?;
    check_system(options.cs, family)?;
    let told = options.format.over(&board.settings()?.rotary_format().of(family))?;
    // Try a reading that the configuration leaves open.
    let settings =
        Settings { rotary_code2: told.rotary_code2.or(Some(RotaryCode2::ALL[0].0)), ..told.clone() };
    let (name, mut program) = match &options.file {
        Some(file) => (shown(file), compiled(file, &settings)?),
        None => {
            let more = family.rotary.home_motors > DEFAULT_FAMILY.rotary.home_motors;
            let text = [SAMPLE, if more { MORE_MOTORS } else { b"" }].concat();
            let sample = compile(&text, &settings).map_err(|error| Failure::Request(error.to_string()))?;
            ("sample".to_owned(), sample.program)
        }
    };
    let mut owner = context.connection()?;
    let buffer = own_buffer(family, options.cs);
    let place = RotaryPlace {
        buffer,
        coordinate_system: options.cs,
        coordinate_system_base: settings.coordinate_system_base,
        define_longs: options.define,
        ..RotaryPlace::default()
    };
    owner.rotary_start(place)?;
    let stopped = feed(&mut board, &program, owner, buffer);
    let listing = list_and_remove(&mut board, options.cs)?;
    let stopped = stopped?;
    if let Some(Stopped { taken, .. }) = &stopped {
        program.lines.truncate(*taken);
    }
    if let Some(warning) = circle_warning(&mut board, &name, &program, options.cs) {
        note(warning);
    }
    let mut problems = differences(&name, &program, &listing, &settings);
    if !problems.is_empty() {
        problems.push(advice(&program, &listing, &settings));
    }
    problems.extend(stopped.map(|stopped| stopped.problem));
    if !problems.is_empty() {
        return Err(Failure::Refused(problems.join("\n")));
    }
    if context.output.is_json() {
        context.output.json(&json!({ "lines": listing }))?;
    } else {
        context.output.line(format_args!("the board lists {} lines as they were sent", listing.len()))?;
        // ABS has the same words by both readings.
        let read = |(place, _)| {
            let by = Settings { rotary_code2: Some(place), ..settings.clone() };
            program.words().map(|words| Item::from_words(words.0, words.1, &by).ok()).collect::<Vec<_>>()
        };
        if told.rotary_code2.is_none() && read(RotaryCode2::ALL[0]) != read(RotaryCode2::ALL[1]) {
            context.output.line(found(RotaryCode2::ALL[0].1))?;
        }
    }
    Ok(Verdict::Yes)
}

/// The board has not taken all lines.
struct Stopped {
    /// The number of lines that the board has taken.
    taken: usize,
    problem: String,
}

/// Feeds the whole program into the board's own rotary buffer; `Some` when the board does not take all lines.
fn feed(
    board: &mut Connection,
    program: &Program,
    owner: Connection,
    buffer: u8,
) -> Result<Option<Stopped>, Failure> {
    let words = |line: &Line| line.commands.iter().map(|own| (own.word1, own.word2)).collect();
    let lines: Vec<_> = program.lines.iter().map(words).collect();
    let mut feed = RotaryFeed::new(owner, buffer, &lines);
    let deadline = Instant::now() + TAKEN_WITHIN;
    let stopped = loop {
        if feed.is_done() {
            feed.renew()?;
        } else {
            feed.step()?;
        }
        let state = board.rotary_state(buffer)?;
        if feed.is_done() && state.ahead_commands == 0 {
            break None;
        }
        if state.error.is_some() || Instant::now() >= deadline {
            let taken = state.sent_lines.saturating_sub(state.ahead_lines) as usize;
            let code =
                state.error.map_or_else(String::new, |code| format!(" and reports rotary error {code}"));
            let hint = if taken == 0 {
                NOTHING_TAKEN
            } else {
                "; without an error, is its buffer long enough (--define)?"
            };
            break Some(Stopped { taken, problem: format!("the board has taken {taken} lines{code}{hint}") });
        }
        std::thread::sleep(ASK_STATE_EVERY);
    };
    feed.stop()?;
    Ok(stopped)
}

/// Lists the board's rotary buffer, and empties it.
fn list_and_remove(board: &mut Connection, cs: u8) -> Result<Vec<String>, Failure> {
    let mut line = |line: &str| {
        let reply = board.send(line, LINE_PATIENCE);
        reply.map_err(|error| Failure::Refused(format!("{line}: {error}")))
    };
    let listing = line(&format!("&{cs}LIST ROT"))?;
    for removal in ["OPEN ROT".to_owned(), format!("&{cs}CLEAR"), "CLOSE".to_owned()] {
        line(&removal)?;
    }
    Ok(listing)
}

/// The words of each line of `text`.
fn words(text: &str, settings: &Settings) -> Option<Vec<Vec<(u32, u32)>>> {
    let program = compile(text.as_bytes(), settings).ok()?.program;
    let line = |line: &Line| line.commands.iter().map(|own| (own.word1, own.word2)).collect();
    Some(program.lines.iter().map(line).collect())
}

/// The lines at which the board's listing differs from the lines sent.
fn differences(name: &str, program: &Program, listing: &[String], settings: &Settings) -> Vec<String> {
    let lines = program.lines.iter().map(Some).chain(std::iter::repeat(None));
    let listed = listing.iter().map(Some).chain(std::iter::repeat(None));
    let both = lines.zip(listed).take(program.lines.len().max(listing.len()));
    let differs = both.filter_map(|(sent, listed)| match (sent, listed) {
        (Some(sent), Some(listed)) => {
            let own: Vec<_> = sent.commands.iter().map(|own| (own.word1, own.word2)).collect();
            let same = words(listed, settings).is_some_and(|lines| lines == [own]);
            (!same).then(|| format!("{name}:{}: sent {}, the board lists {listed}", sent.line, sent.text()))
        }
        (Some(sent), None) => {
            Some(format!("{name}:{}: sent {}, the board lists nothing", sent.line, sent.text()))
        }
        (None, Some(listed)) => Some(format!("{name}: the board lists {listed} besides")),
        (None, None) => None,
    });
    differs.collect()
}

/// The setting that explains the board's listing.
fn advice(program: &Program, listing: &[String], settings: &Settings) -> String {
    let listed = words(&listing.join("\n"), settings);
    let sent: Vec<_> = program.words().collect();
    let fits = |place: RotaryCode2| {
        let other = Settings { rotary_code2: Some(place), ..settings.clone() };
        let lines = decompile(&sent, &other).ok()?.program.lines;
        let text: String = lines.iter().map(|line| line.text() + "\n").collect();
        (listed.is_some() && words(&text, settings) == listed).then_some(())
    };
    match RotaryCode2::ALL.into_iter().find(|(place, _)| fits(*place).is_some()) {
        Some((_, name)) => found(name),
        None => "that is not explained by rotary_code2; compare the numbers of [rotary] in pmacd's configuration, exponent_bias first"
            .to_owned(),
    }
}

/// The setting that the board has shown.
fn found(name: &str) -> String {
    format!(
        "the board reads ABS, INC and FRAX by rotary_code2 = {name:?}: write it under [readings] in pmacd's configuration"
    )
}
