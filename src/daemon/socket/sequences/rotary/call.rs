//! A rotary stream as it was called for.

use crate::daemon::shared::info::Info;
use crate::daemon::shared::job::Job;
use crate::daemon::socket::jobs;
use crate::map::{Family, HostOffset};
use crate::protocol::CallError;
use crate::protocol::calls::{self, LeftLines};
use crate::rotary;

/// A stream as it was called for.
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
    /// ABS, INC and FRAX, which go before the buffers are opened.
    pub(super) modes: Vec<String>,
}

/// The most modes of a stream.
const MODES: usize = 16;

impl RotaryCall {
    /// What `call` asks for.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(in crate::daemon::socket) fn of(call: calls::RotaryStart, info: &Info) -> Result<Self, CallError> {
        let family = info.family();
        let buffer = jobs::rotary_buffer(call.buffer, family)?;
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
            setup: jobs::rotary_set_up(&call, buffer, family)?,
            modes: modes(&call.modes)?,
        })
    }
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
