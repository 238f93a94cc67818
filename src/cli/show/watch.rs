//! `pmacctl motors` and `pmacctl coordinates`, and `pmacctl watch`, which shows the same live, also across restarts of
//! the daemon.

use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};

use crate::cli::args::values::{rate, seconds};
use crate::cli::console::{Interrupt, Keys};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::coordinates::Systems;
use crate::cli::show::motors::{Motors, reason};
use crate::cli::show::screen::{Live, Screen};
use crate::cli::show::user::Words;
use crate::client::Snapshot;
use crate::segment::RegionId;

/// The part to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Part {
    Motors,
    Coordinates,
    /// The words of [[user]] tables in pmacd's configuration
    User,
}

/// There is nothing to watch.
pub const NO_WORDS: &str = "pmacd publishes no words of the site's own: its configuration has no [[user]]; pmacctl setup user prints such tables";

impl Part {
    const fn region(self) -> RegionId {
        match self {
            Self::Motors => RegionId::Servo,
            Self::Coordinates => RegionId::Background,
            Self::User => RegionId::User,
        }
    }

    fn of<'a>(self, context: &Context, snapshot: &'a Snapshot) -> Box<dyn Live + 'a> {
        match self {
            Self::Motors => Box::new(Motors(snapshot)),
            Self::Coordinates => Box::new(Systems::new(context, snapshot)),
            Self::User => Box::new(Words(snapshot)),
        }
    }
}

#[derive(Debug, Args)]
pub struct Watch {
    /// What to show
    #[arg(value_enum, value_name = "WHAT", default_value = "motors")]
    pub what: Part,
    /// Stop after this many prints [default: on q or ^C]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Stop after this time, in seconds
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Option<Duration>,
    /// The most prints a second
    #[arg(long, value_name = "HZ", default_value = "5", value_parser = rate, allow_negative_numbers = true)]
    pub rate: Duration,
}

/// Longest time between prints without new data.
const NO_NEWS: Duration = Duration::from_millis(500);

/// Shows `what` once.
pub fn once(context: &mut Context, what: Part) -> Result<Verdict, Failure> {
    let mut board = context.board()?;
    let snapshot = board.snapshot()?;
    let live = what.of(context, &snapshot);
    if context.output.is_json() {
        context.output.json(&live.document())?;
    } else {
        context.output.text(live.text(None, &mut |stale| reason(&mut board, stale)))?;
    }
    Ok(live.update().1.into())
}

pub fn run(context: &mut Context, options: &Watch) -> Result<Verdict, Failure> {
    let mut board = context.board()?;
    let interactive = context.output.is_terminal();
    let region = options.what.region();
    if options.what == Part::User && board.subscriber().region(region).is_err() {
        return Err(Failure::Request(NO_WORDS.to_owned()));
    }
    let mut screen = Screen::new(interactive);
    let keys = Keys::listen(interactive && !context.output.is_json());
    // Catch signals only where the terminal must be restored at the end.
    let interrupt = if keys.are_heard() { Some(Interrupt::listen()?) } else { None };
    let hint = if keys.are_heard() { " (q ends it)" } else { "" };
    let title = format!("{}{hint}", board.name());
    let end = options.seconds.and_then(|seconds| Instant::now().checked_add(seconds));
    let mut printed = 0;
    let mut fresh = false;
    let mut after = 0;
    while end.is_none_or(|end| Instant::now() < end) {
        let began = Instant::now();
        board.wait_for(region, after, left(end).min(NO_NEWS))?;
        let snapshot = board.snapshot()?;
        let live = options.what.of(context, &snapshot);
        screen.show(&mut context.output, &title, &*live)?;
        (after, fresh) = live.update();
        context.output.flush()?;
        printed += 1;
        if options.count.is_some_and(|count| printed >= count) {
            break;
        }
        let rest = options.rate.saturating_sub(began.elapsed()).min(left(end));
        if keys.quit_within(rest) || interrupt.as_ref().is_some_and(Interrupt::came) {
            break;
        }
    }
    Ok(fresh.into())
}

fn left(end: Option<Instant>) -> Duration {
    end.map_or(Duration::MAX, |end| end.saturating_duration_since(Instant::now()))
}
