//! `pmacctl panel`: home, run, stop and feed rate override through the control panel of the DPRAM (I2=3).

use std::time::{Duration, Instant};

use clap::{Args, Subcommand};
use serde::Serialize;

use crate::cli::act::hold::{Hold, hold};
use crate::cli::act::wait::{Goal, Wait, Watch, see_programs_begin, wait_for_motors, wait_for_programs};
use crate::cli::args::values::number;
use crate::cli::console::{Table, note, warn_if_late};
use crate::cli::context::{Context, Failure, Verdict, check_numbers};
use crate::client::Connection;
use crate::function::panel::{FeedOverride, PanelAction, PanelWords};
use crate::map::Family;

/// How long the daemon may take to identify its board.
const ASKING: Duration = Duration::from_secs(2);

/// `panel`.
#[derive(Debug, Args)]
pub struct Panel {
    #[command(subcommand)]
    pub command: PanelCommand,
}

#[derive(Debug, Subcommand)]
pub enum PanelCommand {
    /// Jog motors in the positive direction until they are stopped
    #[command(name = "jog+", hide = true)]
    JogPlus(Jog),
    /// Jog motors in the negative direction until they are stopped
    #[command(name = "jog-", hide = true)]
    JogMinus(Jog),
    /// Stop jogging motors
    #[command(hide = true)]
    JogStop(Motions),
    /// Jog motors to the pre-jog position: where the last stop or hold of a program, or the last J==, left them
    PreJog(Motors),
    /// Home motors
    Home(Motions),
    /// Run the programs of coordinate systems. Exit status 1: pmacctl did not see a program run
    Start(Programs),
    /// Execute one step of the programs of coordinate systems. A running program stops, as after Q
    Step(Systems),
    /// Abort coordinate systems
    Stop(Systems),
    /// Hold the feed of coordinate systems
    Hold(Systems),
    /// Override the feed rate of a coordinate system. This works while its Ix93 has its default value, the panel's override
    Feed(Feed),
    /// Show for each number the last request, whether the request still waits for the board, and the override. The panel
    /// keeps a request after the board took it or pmacd withdrew it
    Show,
}

#[derive(Debug, Args)]
pub struct Jog {
    #[command(flatten)]
    pub motors: Motors,
    #[command(flatten)]
    pub hold: Hold,
}

#[derive(Debug, Args)]
pub struct Motors {
    /// Motors, by number
    #[arg(required = true, value_name = "MOTOR", value_parser = number)]
    pub numbers: Vec<u8>,
}

#[derive(Debug, Args)]
pub struct Motions {
    #[command(flatten)]
    pub motors: Motors,
    #[command(flatten)]
    pub wait: Wait,
}

#[derive(Debug, Args)]
pub struct Programs {
    #[command(flatten)]
    pub systems: Systems,
    /// Start, though this also runs lines that an interrupted rotary stream left
    #[arg(long = "continue")]
    pub continue_left: bool,
    #[command(flatten)]
    pub wait: Wait,
}

#[derive(Debug, Args)]
pub struct Systems {
    /// Coordinate systems, by number
    #[arg(required = true, value_name = "C.S.", value_parser = number)]
    pub numbers: Vec<u8>,
}

#[derive(Debug, Args)]
pub struct Feed {
    /// The coordinate system
    #[arg(value_name = "C.S.", value_parser = number)]
    pub system: u8,
    /// A percentage (50%), a raw value of 0 to 32767 in 1/32768 ms (14507 is 100 % at the default I10), or off
    #[arg(value_name = "N%|RAW|off", value_parser = wanted, allow_hyphen_values = true)]
    pub wanted: WantedFeed,
}

/// The requested override.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WantedFeed {
    Percent(f64),
    Raw(FeedOverride),
    Off,
}

fn wanted(text: &str) -> Result<WantedFeed, String> {
    if text.eq_ignore_ascii_case("off") {
        return Ok(WantedFeed::Off);
    }
    if let Some(percent) = text.strip_suffix('%') {
        let percent: f64 = percent.trim().parse().map_err(|_| format!("{percent:?} is not a number"))?;
        return if percent.is_finite() && percent >= 0.0 {
            Ok(WantedFeed::Percent(percent))
        } else {
            Err("a percentage must be 0 or more".to_owned())
        };
    }
    let raw: u32 = text.parse().map_err(|_| "write 50%, a raw value from 0 to 32767, or off".to_owned())?;
    FeedOverride::from_raw(raw).map(WantedFeed::Raw).map_err(|error| error.to_string())
}

pub fn run(context: &mut Context, options: &Panel) -> Result<Verdict, Failure> {
    let motions = |motions: &Motions| (motions.motors.numbers.clone(), motions.wait);
    let at_once = |numbers: &[u8]| (numbers.to_owned(), Wait::default());
    let (action, (numbers, wait)) = match &options.command {
        PanelCommand::JogPlus(jog) => return self::jog(context, PanelAction::JogPlus, jog),
        PanelCommand::JogMinus(jog) => return self::jog(context, PanelAction::JogMinus, jog),
        PanelCommand::JogStop(motors) => (PanelAction::JogStop, motions(motors)),
        PanelCommand::PreJog(motors) => (PanelAction::PreJog, at_once(&motors.numbers)),
        PanelCommand::Home(motors) => (PanelAction::Home, motions(motors)),
        PanelCommand::Start(programs) => {
            (PanelAction::Start, (programs.systems.numbers.clone(), programs.wait))
        }
        PanelCommand::Step(systems) => (PanelAction::Step, at_once(&systems.numbers)),
        PanelCommand::Stop(systems) => (PanelAction::Stop, at_once(&systems.numbers)),
        PanelCommand::Hold(systems) => (PanelAction::Hold, at_once(&systems.numbers)),
        PanelCommand::Feed(feed) => return self::feed(context, feed),
        PanelCommand::Show => return show(context),
    };
    let confirms = matches!(&options.command, PanelCommand::Start(programs) if programs.continue_left);
    press(context, Press { confirms, ..Press::of(action) }, &numbers, wait)
}

/// A request to the board.
#[derive(Debug, Clone, Copy)]
pub struct Press {
    pub action: PanelAction,
    /// A line stands for the panel's key, where the daemon sends lines.
    pub by_line: bool,
    /// A start also runs the lines that a rotary stream left.
    pub confirms: bool,
    /// A start ends a hold. A start by line that does not is for a coordinate system that runs no program.
    pub resumes: bool,
}

impl Press {
    /// By the panel.
    pub const fn of(action: PanelAction) -> Self {
        Self { action, by_line: false, confirms: false, resumes: false }
    }

    /// By line.
    pub const fn by_line(action: PanelAction) -> Self {
        Self { by_line: true, ..Self::of(action) }
    }
}

/// Makes a request, and waits for its end if `wait` is given.
pub fn press(context: &mut Context, press: Press, numbers: &[u8], wait: Wait) -> Result<Verdict, Failure> {
    let Press { action, by_line, confirms, resumes } = press;
    let goal = match action {
        PanelAction::Home => Goal::Home,
        PanelAction::JogPlus | PanelAction::JogMinus if wait.wait => {
            let why = "a jog without an end cannot be waited for; nothing was sent";
            return Err(Failure::Request(why.to_owned()));
        }
        _ => Goal::Stands,
    };
    let ready = |mut watch: Watch| {
        match action {
            // A killed motor is a stopped motor.
            PanelAction::JogStop => Ok(()),
            PanelAction::Start if resumes => Ok(()),
            action if action.is_for_motors() => watch.check_motors(numbers),
            _ => watch.check_systems(numbers),
        }
        .map(|()| watch)
    };
    let request = || -> Result<_, Failure> {
        let mut connection = context.connection()?.confirming(confirms);
        check_numbers(Context::family(None, &mut connection)?, action.is_for_motors(), numbers)?;
        let watch = wait.wait.then(|| Watch::begin(context, &mut connection).and_then(ready));
        let watch = match watch {
            Some(Err(failure)) if action != PanelAction::JogStop => return Err(failure.at("not sent")),
            watch => watch,
        };
        // The board accepts the request for a program that it cannot run, and drops it.
        let starts = action == PanelAction::Start && watch.is_none();
        let mut start = starts.then(|| Watch::begin(context, &mut connection));
        if let Some(Ok(watch)) = start.as_mut().filter(|_| by_line && !resumes) {
            watch.check_systems(numbers).map_err(|failure| failure.at("not sent"))?;
        }
        if !by_line {
            connection.panel(action.name(), numbers)?;
            return Ok((connection, watch, start));
        }
        for (index, &number) in numbers.iter().enumerate() {
            connection.panel_or_line(action.name(), number).map_err(|error| {
                let error = Failure::from(error);
                let taken = numbers[..index].iter().map(u8::to_string).collect::<Vec<_>>().join(", ");
                if taken.is_empty() {
                    error
                } else {
                    error.at(format_args!("{number}, after {taken} was taken"))
                }
            })?;
        }
        Ok((connection, watch, start))
    };
    let stops = matches!(action, PanelAction::JogStop | PanelAction::Stop | PanelAction::Hold);
    let (mut connection, watch, start) = if stops { warn_if_late(request) } else { request() }?;
    match start {
        Some(Ok(mut watch)) => return see_programs_begin(&mut connection, &mut watch, numbers),
        Some(Err(failure)) => {
            note(format_args!(
                "pmacctl: the start was taken; whether the program runs is not known: {failure}"
            ));
            return Ok(Verdict::No);
        }
        None => {}
    }
    let Some(watch) = watch else { return Ok(Verdict::Yes) };
    let mut watch = watch.map_err(|failure| failure.at("the stop was taken"))?;
    if action.is_for_motors() {
        wait_for_motors(context, &mut connection, &mut watch, numbers, goal, wait.timeout)
    } else {
        wait_for_programs(context, &mut connection, &mut watch, numbers, wait.timeout)
    }
}

fn jog(context: &mut Context, action: PanelAction, jog: &Jog) -> Result<Verdict, Failure> {
    let numbers = &jog.motors.numbers;
    match jog.hold {
        Hold { hold: true, seconds } => hold(context, action, numbers, seconds),
        _ => press(context, Press::of(action), numbers, Wait::default()),
    }
}

fn feed(context: &mut Context, feed: &Feed) -> Result<Verdict, Failure> {
    let mut connection = context.connection()?;
    let i10 = match feed.wanted {
        WantedFeed::Percent(_) => wait_for_i10(context),
        _ => i10(context),
    };
    let value = match feed.wanted {
        WantedFeed::Off => None,
        WantedFeed::Raw(value) => Some(value),
        WantedFeed::Percent(percent) => {
            let i10 = i10.ok_or_else(|| {
                Failure::Request(
                    "the board has not told I10, so a percentage means nothing; give a raw value".into(),
                )
            })?;
            Some(from_percent(percent, i10)?)
        }
    };
    let family = Context::family(None, &mut connection)?;
    check_numbers(family, false, &[feed.system])?;
    let last = match value {
        None => last_override(&mut connection, family, feed.system)?,
        Some(_) => None,
    };
    let notes = connection.feed_override(feed.system, value.map(FeedOverride::raw))?;
    let percent = value.zip(i10).and_then(|(value, i10)| value.percent(i10));
    for told in &notes {
        note(format_args!("&{}: {told}", feed.system));
    }
    if context.output.is_json() {
        let raw = value.map(FeedOverride::raw);
        context.output.json(&serde_json::json!({
            "coordinate_system": feed.system, "raw": raw, "percent": percent, "notes": notes
        }))?;
    } else {
        context.output.line(format_args!("&{}: {}", feed.system, echo(value, percent, last, i10)))?;
    }
    Ok(Verdict::Yes)
}

/// The override of coordinate system `system`, if it is on.
fn last_override(
    connection: &mut Connection,
    family: &Family,
    system: u8,
) -> Result<Option<FeedOverride>, Failure> {
    let words = panel_words(connection, family)?;
    let index = usize::from(system) - 1;
    let raw = words.overrides.get(index).filter(|_| words.override_enable >> index & 1 != 0);
    Ok(raw.and_then(|&raw| FeedOverride::from_raw(raw.into()).ok()))
}

/// The override for a percentage.
///
/// # Errors
/// The percentage does not fit the panel's word.
fn from_percent(percent: f64, i10: u32) -> Result<FeedOverride, Failure> {
    let value = FeedOverride::from_percent(percent, i10).map_err(Failure::request)?;
    let most = FeedOverride::MAXIMUM;
    match most.percent(i10) {
        // Allow rounding by half a unit, and refuse anything beyond that.
        Some(got) if value == most && percent > got * (1.0 + 0.5 / f64::from(most.raw())) => {
            // Rounded down, so that the printed limit is accepted when typed.
            let told = (got * 100.0).floor() / 100.0;
            Err(Failure::Request(format!(
                "{percent} % is more than the panel's word can hold; at this board's I10 the highest override is {told:.2}%"
            )))
        }
        _ => Ok(value),
    }
}

/// The new setting in both units, so that the user sees a forgotten %. For `off`, the `last` value.
fn echo(
    value: Option<FeedOverride>,
    percent: Option<f64>,
    last: Option<FeedOverride>,
    i10: Option<u32>,
) -> String {
    let Some(value) = value else {
        let Some(last) = last else { return "off; it was not on".to_owned() };
        let last = match i10.and_then(|i10| last.percent(i10)) {
            Some(percent) => format!("{percent:.2} %"),
            None => format!("{} raw", last.raw()),
        };
        return format!("off; the board keeps the last override (now {last}) until it is set another way");
    };
    let raw = format!("{} of {} raw", value.raw(), FeedOverride::MAXIMUM.raw());
    match percent {
        Some(percent) => format!("{raw} = {percent:.2} %"),
        None => format!("{raw}; the board has not told I10, so the percentage is not known"),
    }
}

/// The servo period. Waits for a daemon that has just started to identify its board.
fn wait_for_i10(context: &Context) -> Option<u32> {
    let deadline = Instant::now() + ASKING;
    loop {
        match i10(context) {
            None if Instant::now() < deadline => std::thread::sleep(Duration::from_millis(20)),
            found => return found,
        }
    }
}

/// The servo period in the segment, if it is known.
fn i10(context: &Context) -> Option<u32> {
    context.board().ok()?.identity().ok()?.i10
}

/// The whole panel, as `panel show` prints it.
#[derive(Debug, Serialize)]
struct Shown {
    request_enable: u16,
    override_enable: u16,
    numbers: Vec<Number>,
}

/// The motor and the coordinate system with this number.
#[derive(Debug, Serialize)]
struct Number {
    number: usize,
    /// The request still waits for the board.
    pending: bool,
    request: u16,
    /// The actions in the request word. They stay after the board takes the request or the daemon withdraws it.
    actions: Vec<&'static str>,
    override_enabled: bool,
    override_raw: u16,
    override_percent: Option<f64>,
}

fn show(context: &mut Context) -> Result<Verdict, Failure> {
    let mut connection = context.connection()?;
    let family = Context::family(None, &mut connection)?;
    let shown = shown(&panel_words(&mut connection, family)?, i10(context));
    context.output.show(&shown, || table(&shown))?;
    Ok(Verdict::Yes)
}

/// The words of the control panel.
pub fn panel_words(connection: &mut Connection, family: &Family) -> Result<PanelWords, Failure> {
    let Some(panel) = &family.panel else {
        return Err(Failure::Request(format!("a {} has no control panel in its DPRAM", family.title)));
    };
    let region = panel.region;
    let (_, words) = connection.read(region.start, region.words())?;
    if words.len() != region.words() {
        return Err(Failure::Request(
            "the daemon sent too few words; use a pmacd and a pmacctl of the same version".into(),
        ));
    }
    Ok(PanelWords::of(panel, &words))
}

fn shown(words: &PanelWords, i10: Option<u32>) -> Shown {
    let numbers = (1..).zip(words.requests.iter().zip(&words.overrides)).map(|(number, (&request, &raw))| {
        let bit = 1 << (number - 1);
        let value = FeedOverride::from_raw(raw.into()).ok();
        Number {
            number,
            pending: words.request_enable & bit != 0,
            request,
            actions: actions(request),
            override_enabled: words.override_enable & bit != 0,
            override_raw: raw,
            override_percent: value.zip(i10).and_then(|(value, i10)| value.percent(i10)),
        }
    });
    Shown {
        request_enable: words.request_enable,
        override_enable: words.override_enable,
        numbers: numbers.collect(),
    }
}

/// The actions in a request word. Both jog bits together mean stop.
fn actions(request: u16) -> Vec<&'static str> {
    let has = |action: PanelAction| request & action.bits() == action.bits();
    let stop = has(PanelAction::JogStop);
    let part_of_stop = |action| matches!(action, PanelAction::JogMinus | PanelAction::JogPlus);
    let named = PanelAction::ALL.into_iter().filter(|&action| has(action) && !(stop && part_of_stop(action)));
    named.map(PanelAction::name).collect()
}

fn table(shown: &Shown) -> Table {
    let mut table = Table::new(">number|request word|waits|override|>raw|>percent");
    for number in &shown.numbers {
        table.row([
            number.number.to_string(),
            if number.actions.is_empty() { "-".to_owned() } else { number.actions.join(" ") },
            if number.pending { "yes" } else { "-" }.to_owned(),
            if number.override_enabled { "on" } else { "off" }.to_owned(),
            number.override_raw.to_string(),
            number.override_percent.map_or_else(String::new, |percent| format!("{percent:.2}")),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_feed_rate_is_typed_in_three_ways() {
        assert_eq!(wanted("50%"), Ok(WantedFeed::Percent(50.0)));
        assert_eq!(wanted("112.5 %"), Ok(WantedFeed::Percent(112.5)));
        assert_eq!(wanted("14507"), Ok(WantedFeed::Raw(FeedOverride::from_raw(14_507).unwrap())));
        assert_eq!(wanted("OFF"), Ok(WantedFeed::Off));
        for wrong in ["", "%", "-1%", "nan%", "inf%", "32768", "-1", "0.5", "half"] {
            assert!(wanted(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_panel_is_shown_as_it_lies_there() {
        let mut words = PanelWords {
            request_enable: 0b10,
            override_enable: 1,
            requests: vec![0; 8],
            overrides: vec![0; 8],
        };
        words.requests[1] = 0x0300;
        words.requests[2] = 0x0A00;
        words.overrides[0] = 14_507;
        let shown = shown(&words, Some(3_713_707));
        assert_eq!(shown.numbers[1].actions, ["jog-stop"]);
        assert_eq!(shown.numbers[2].actions.len(), 2);
        assert!(shown.numbers[1].pending && !shown.numbers[0].pending && shown.numbers[0].override_enabled);
        assert!((shown.numbers[0].override_percent.unwrap() - 100.0).abs() < 0.01);
        let table = table(&shown).to_string();
        let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split_whitespace().collect()).collect();
        assert_eq!(rows.len(), 9);
        assert_eq!(rows[2][..3], ["2", "jog-stop", "yes"], "it waits");
        assert_eq!(rows[4][..4], ["4", "-", "-", "off"], "nothing is claimed of what nobody asked for");
    }

    #[test]
    fn a_percentage_there_is_no_room_for_is_refused_and_what_was_set_is_told() {
        let i10 = 3_713_707;
        for (percent, raw) in [(50.0, 7253), (225.87, 32_766), (0.0, 0)] {
            assert_eq!(from_percent(percent, i10).unwrap().raw(), raw, "{percent}");
        }
        for percent in [225.88, 226.0, 500.0] {
            let Err(Failure::Request(text)) = from_percent(percent, i10) else { panic!("{percent}") };
            assert!(text.contains(&format!("{percent} % is more")) && text.contains("225.87%"), "{text}");
        }
        let value = FeedOverride::from_raw(50).unwrap();
        assert_eq!(echo(Some(value), value.percent(i10), None, Some(i10)), "50 of 32767 raw = 0.34 %");
        assert!(echo(Some(value), None, None, None).starts_with("50 of 32767 raw; "));
        let off = |last, i10| echo(None, None, last, i10);
        assert_eq!(off(None, Some(i10)), "off; it was not on");
        assert!(
            off(Some(value), Some(i10)).starts_with("off; the board keeps the last override (now 0.34 %)")
        );
        assert!(off(Some(value), None).contains("(now 50 raw)"));
    }
}
