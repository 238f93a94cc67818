//! `pmacctl home`, `run`, `resume`, `step` and `hold`: the keys of the control panel, on boards without one, too.
//!
//! The daemon sends a command line for them, so the panel may be off (I2). It sends a hold by the panel, as every stop,
//! and by command line if the panel does not act.

use clap::Args;

use crate::cli::act::jog::motors;
use crate::cli::act::panel::{Press, Programs, Systems, press};
use crate::cli::act::wait::{Wait, without_program};
use crate::cli::console::note;
use crate::cli::context::{Context, Failure, Verdict};
use crate::function::panel::PanelAction;

/// `home`.
#[derive(Debug, Args)]
pub struct Home {
    /// The motors, by number or by their names in the configuration: 1 3, or 1,3
    #[arg(value_name = "MOTOR", value_delimiter = ',', required = true)]
    pub motors: Vec<String>,
    #[command(flatten)]
    pub wait: Wait,
}

pub fn home(context: &mut Context, options: &Home) -> Result<Verdict, Failure> {
    let numbers = motors(context, &options.motors)?;
    press(context, Press::by_line(PanelAction::Home), &numbers, options.wait)
}

pub fn run(context: &mut Context, options: &Programs) -> Result<Verdict, Failure> {
    start(context, options, false)
}

pub fn resume(context: &mut Context, options: &Programs) -> Result<Verdict, Failure> {
    start(context, options, true)
}

fn start(context: &mut Context, options: &Programs, resumes: bool) -> Result<Verdict, Failure> {
    let Programs { systems, continue_left, wait } = options;
    let start = Press { confirms: *continue_left, resumes, ..Press::by_line(PanelAction::Start) };
    press(context, start, &systems.numbers, *wait)
}

pub fn step(context: &mut Context, options: &Systems) -> Result<Verdict, Failure> {
    press(context, Press::by_line(PanelAction::Step), &options.numbers, Wait::default())
}

pub fn hold(context: &mut Context, options: &Systems) -> Result<Verdict, Failure> {
    let verdict = press(context, Press::of(PanelAction::Hold), &options.numbers, Wait::default())?;
    let idle = context.board()?.snapshot().map(|snapshot| without_program(&snapshot, &options.numbers));
    for system in idle.unwrap_or_default() {
        note(format_args!(
            "pmacctl: &{system} runs no program and is held; until abort {system} its motors make no jog and no home search"
        ));
    }
    Ok(verdict)
}
