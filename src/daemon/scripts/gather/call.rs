//! The client's request for a gather.

use crate::daemon::shared::info::Info;
use crate::daemon::shared::parameters::inside;
use crate::function::gather::GatherBuffer;
use crate::gather::{GatherMode, MOST_PERIOD, gather_lines};
use crate::map::{Family, GatherPlace, PmacRegister};
use crate::protocol::{CallError, Function, calls};

/// A client's request for a gather.
#[derive(Debug)]
pub struct GatherCall {
    pub(super) family: &'static Family,
    pub(super) buffer: GatherBuffer,
    /// The lines up to `DEFINE GATHER`.
    pub(super) lines: Vec<String>,
    pub(super) servo_period_ns: Option<u64>,
    /// Whether the gather uses the servo report.
    pub(super) uses_report: bool,
}

impl GatherCall {
    /// The request that `call` makes.
    ///
    /// # Errors
    /// The fault in the call.
    pub fn of(call: calls::GatherStart, info: &Info) -> Result<Self, CallError> {
        let calls::GatherStart { registers, size_longs, period, wrap, servo_period_ns, .. } = call;
        let family = info.family();
        let place = GatherPlace {
            buffer: inside(call.buffer, 1, "buffer", family)?,
            size: inside(call.size_word, 1, "size_word", family)?,
            index: inside(call.index_word, 1, "index_word", family)?,
        };
        let most = family.i.most_gather_sources();
        if !(1..=most).contains(&registers.len()) {
            return Err(CallError::invalid(
                "registers",
                format_args!("1 to {most}, not {}", registers.len()),
            ));
        }
        let registers = registers.iter().map(|text| PmacRegister::parse(text, family));
        let registers: Vec<PmacRegister> =
            registers.collect::<Result<_, _>>().map_err(|reason| CallError::invalid("registers", reason))?;
        // A longer period does not fit the variable: the board would make another period of it, or 0, which ends the
        // report.
        if !(1..=MOST_PERIOD).contains(&period) {
            return Err(CallError::invalid("period", format_args!("1 to {MOST_PERIOD} servo cycles")));
        }
        if servo_period_ns == Some(0) {
            return Err(CallError::invalid("servo_period_ns", "a servo cycle in nanoseconds"));
        }
        let mode = if wrap.unwrap_or(true) { GatherMode::Wrap } else { GatherMode::Stop };
        let codes: Vec<u32> = registers.iter().map(|register| register.gather_code()).collect();
        Ok(Self {
            lines: gather_lines(&family.i, &codes, period, mode, size_longs),
            buffer: GatherBuffer {
                place,
                room_longs: (family.length - place.buffer.bytes()) / 4,
                size_longs,
                sample_longs: registers.iter().map(|register| register.longs()).sum(),
                longest_sample: family.i.longest_gather_sample(),
                mode,
                period,
            },
            servo_period_ns,
            uses_report: info.why_not(Function::Servo).is_none(),
            family,
        })
    }
}
