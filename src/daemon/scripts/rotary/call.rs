//! The client's request for a rotary stream.

use crate::daemon::shared::info::Info;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::parameters::{check_number, inside, rotary_buffer};
use crate::map::{Family, HostOffset};
use crate::protocol::CallError;
use crate::protocol::calls::{self, LeftLines};
use crate::rotary;

/// A client's request for a stream.
#[derive(Debug)]
pub struct RotaryCall {
    pub(super) family: &'static Family,
    /// The index of the buffer.
    pub(super) buffer: usize,
    pub(super) header: HostOffset,
    pub(super) setup: Job,
    pub(super) coordinate_system: u8,
    pub(super) define: Option<u32>,
    pub(super) left: Option<LeftLines>,
    pub(super) run: bool,
    pub(super) may_stand: bool,
    /// ABS, INC and FRAX lines, which the daemon sends before it opens the buffers.
    pub(super) modes: Vec<String>,
}

/// The most modes of a stream.
const MODES: usize = 16;

impl RotaryCall {
    /// The request that `call` makes.
    ///
    /// # Errors
    /// The fault in the call.
    pub fn of(call: calls::RotaryStart, info: &Info) -> Result<Self, CallError> {
        let family = info.family();
        let buffer = rotary_buffer(call.buffer, family)?;
        let header = family.rotary.headers.get(buffer).copied();
        if family.rotary.one_a_system && buffer != family.rotary.index_for(call.coordinate_system.into()) {
            let own = format_args!("{}, the coordinate system's own", call.coordinate_system);
            return Err(CallError::invalid("buffer", own));
        }
        Ok(Self {
            family,
            buffer,
            header: header.ok_or_else(|| CallError::invalid("buffer", "one that the board has"))?,
            coordinate_system: call.coordinate_system,
            define: call.define_longs,
            left: call.left,
            run: call.run.unwrap_or(false),
            may_stand: call.may_stand.unwrap_or(false),
            setup: set_up(&call, buffer, family)?,
            modes: modes(&call.modes)?,
        })
    }
}

/// The job that sets up the rotary buffer at index `buffer`.
fn set_up(call: &calls::RotaryStart, buffer: usize, family: &Family) -> Result<Job, CallError> {
    check_number(call.coordinate_system.into(), family.coordinate_systems, "coordinate_system")?;
    if call.coordinate_system_base > 1 {
        return Err(CallError::invalid("coordinate_system_base", "0 or 1"));
    }
    Ok(Job::RotaryOpen {
        buffer,
        start: call.start.map(|start| inside(start, 1, "start", family)).transpose()?,
        size_longs: call.size_longs,
        coordinate_system: call.coordinate_system,
        coordinate_system_base: call.coordinate_system_base,
    })
}

/// The lines of these modes.
fn modes(given: &[String]) -> Result<Vec<String>, CallError> {
    let line = |mode: &String| {
        let (compiled, mut modes) =
            rotary::compile_stream(mode.as_bytes(), &rotary::Settings::default()).ok()?;
        modes.pop().filter(|_| modes.is_empty() && compiled.program.lines.is_empty())
    };
    let lines: Option<Vec<_>> = given.iter().map(line).collect();
    lines
        .filter(|lines| lines.len() <= MODES)
        .ok_or_else(|| CallError::invalid("modes", format_args!("ABS, INC or FRAX each, {MODES} at most")))
}
