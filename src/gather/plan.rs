//! The lines that make a board gather, and the samples' contents (DPRAM manual p. 25-26).

use serde::Serialize;

use super::{Column, Source};
use crate::decode::Scales;
use crate::map::{IVariables, Layout, PmacRegister};

/// The longest period in servo cycles.
pub const MOST_PERIOD: u32 = 8_388_607;

/// The board's action at the buffer's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum GatherMode {
    /// I45=2: gathering ends.
    Stop,
    /// I45=3: gathering goes on at the start, over the oldest samples.
    #[default]
    Wrap,
}

/// A request to gather.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GatherRequest {
    /// The sources, all different, of 1 to 24 registers together on PMAC and PMAC2.
    pub sources: Vec<Source>,
    /// Servo cycles from one sample to the next (I19), 1 or more. The servo report comes as often.
    pub period: u32,
    /// The board's action at the buffer's end.
    pub mode: GatherMode,
    /// The buffer's length in longs, rounded up to whole samples; `None` takes all the room. Buffers for variables and
    /// binary rotary programs share the room: with any of them, give the rest by [`crate::map::buffer_layout`], less a
    /// sample for the rounding.
    pub buffer_longs: Option<u32>,
}

/// How to gather.
#[derive(Debug, Clone, PartialEq)]
pub struct GatherPlan {
    /// The registers of a sample, in order.
    pub registers: Vec<PmacRegister>,
    /// Longs of one sample.
    pub sample_longs: u32,
    /// Longs of the buffer, a multiple of `sample_longs`.
    pub buffer_longs: u32,
    /// The board's action at the buffer's end.
    pub mode: GatherMode,
    /// Servo cycles from one sample to the next.
    pub period: u32,
    /// The samples' contents, in order.
    pub columns: Vec<Column>,
}

/// An impossible request.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Too few or too many registers.
    #[error("{count} registers cannot be gathered at once; 1 to {most} can (I{first} to I{last})")]
    Sources {
        /// The requested number.
        count: usize,
        /// The largest possible number.
        most: usize,
        /// The first register's I-variable.
        first: usize,
        /// The last source's.
        last: usize,
    },
    /// The same source twice.
    #[error("{name} is asked for twice; once is enough")]
    Twice {
        /// Its name.
        name: String,
    },
    /// A period outside the range.
    #[error(
        "a period of {period} servo cycles is not possible; 1 to {MOST_PERIOD} are (I{variable}; 0 stops gathering)"
    )]
    Period {
        /// The requested period.
        period: u32,
        /// The I-variable of the period.
        variable: u16,
    },
    /// The buffer does not fit.
    #[error(
        "a gather buffer of {longs} longs, in whole samples of {sample_longs}, is not possible; there is room for {room} from {start} on"
    )]
    Buffer {
        /// The requested length in longs.
        longs: u32,
        /// Longs of one sample.
        sample_longs: u32,
        /// The longest buffer that fits.
        room: u32,
        /// The buffer's place on the board, as a PMAC address.
        start: String,
    },
}

/// The lines up to and with `DEFINE GATHER`, in order, for registers with these `codes`. After them the index is 0 and
/// the board stores nothing: the time to begin reading, before `GATHER`.
#[must_use]
pub fn gather_lines(
    i: &IVariables,
    codes: &[u32],
    period: u32,
    mode: GatherMode,
    buffer_longs: u32,
) -> Vec<String> {
    let settings = i.gather_settings(codes).map(|(number, value)| format!("I{number}=${value:06X}"));
    let mut lines = vec![format!("I{}={period}", i.gather_period)];
    lines.extend(settings);
    lines.push(format!("I{}={}", i.gather_mode, if mode == GatherMode::Wrap { 3 } else { 2 }));
    lines.push(format!("DEFINE GATHER {buffer_longs}"));
    lines
}

/// Longs that the gather buffer of a board with `layout` can have.
fn room_longs(layout: &Layout) -> u32 {
    layout.family().length.saturating_sub(layout.gather().buffer.bytes()) / 4
}

/// Plans a gather on a board with `layout`; `scales` may have gaps.
///
/// # Errors
/// [`PlanError`]; the caller has nothing to undo then.
pub fn plan(request: &GatherRequest, layout: &Layout, scales: &Scales) -> Result<GatherPlan, PlanError> {
    let sources = &request.sources;
    let registers: Vec<PmacRegister> = sources.iter().flat_map(|source| source.registers.clone()).collect();
    let count = registers.len();
    let i = &layout.family().i;
    let most = i.most_gather_sources();
    if !(1..=most).contains(&count) {
        let first = usize::from(i.gather_sources);
        return Err(PlanError::Sources { count, most, first, last: first + most - 1 });
    }
    for (n, source) in sources.iter().enumerate() {
        if sources[..n].iter().any(|other| other.name == source.name) {
            return Err(PlanError::Twice { name: source.name.clone() });
        }
    }
    let period = request.period;
    if !(1..=MOST_PERIOD).contains(&period) {
        return Err(PlanError::Period { period, variable: i.gather_period });
    }
    let sample_longs: u32 = sources.iter().map(Source::longs).sum();
    let room = room_longs(layout);
    let buffer_longs = match request.buffer_longs {
        Some(longs) => longs.div_ceil(sample_longs).saturating_mul(sample_longs),
        None => room / sample_longs * sample_longs,
    };
    if buffer_longs == 0 || buffer_longs > room {
        let family = layout.family();
        let start = family.print_number(family.pmac_number(layout.gather().buffer));
        let longs = request.buffer_longs.unwrap_or(room);
        return Err(PlanError::Buffer { longs, sample_longs, room, start });
    }
    Ok(GatherPlan {
        registers,
        sample_longs,
        buffer_longs,
        mode: request.mode,
        period,
        columns: sources.iter().map(|source| Column::new(source, scales)).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    fn request(names: &[&str]) -> GatherRequest {
        let layout = Layout::new(&PMAC, None);
        GatherRequest {
            sources: names.iter().map(|name| Source::parse(name, &layout).unwrap()).collect(),
            period: 1,
            mode: GatherMode::Wrap,
            buffer_longs: None,
        }
    }

    fn planned(request: &GatherRequest, firmware: Option<&str>) -> Result<GatherPlan, PlanError> {
        let layout = Layout::new(&PMAC, firmware.map(|version| version.parse().unwrap()));
        plan(request, &layout, &Scales::default())
    }

    #[test]
    fn the_lines_in_their_order() {
        let mut request = request(&["1.actual_position", "1.commanded_position", "X:$0033"]);
        request.period = 4;
        request.buffer_longs = Some(2998);
        let made = planned(&request, None).unwrap();
        let codes: Vec<u32> = made.registers.iter().map(|register| register.gather_code()).collect();
        let lines = |mode| gather_lines(&PMAC.i, &codes, made.period, mode, made.buffer_longs);
        assert_eq!(
            lines(made.mode),
            [
                "I19=4",
                "I20=$000007",
                "I21=$80002B",
                "I22=$800028",
                "I23=$400033",
                "I45=3",
                "DEFINE GATHER 3000",
            ]
        );
        assert_eq!((made.sample_longs, made.buffer_longs, made.columns.len()), (5, 3000, 3));
        assert!(lines(GatherMode::Stop).contains(&"I45=2".to_owned()));
    }

    #[test]
    fn sizes_are_whole_samples_and_fit_where_the_firmware_has_the_buffer() {
        // The manual's example: 4000 longs at 3 a sample become 4002.
        let mut request = request(&["1.actual_position", "X:$0033"]);
        request.buffer_longs = Some(4000);
        assert!(matches!(planned(&request, None), Err(PlanError::Buffer { longs: 4000, room: 3584, .. })));
        request.buffer_longs = None;
        assert_eq!(planned(&request, None).unwrap().buffer_longs, 3582);
        assert_eq!(planned(&request, Some("1.16D")).unwrap().buffer_longs, 3519);
        request.buffer_longs = Some(3520);
        let error = planned(&request, Some("1.16D")).unwrap_err().to_string();
        assert!(error.contains("room for 3520 from $D240 on"), "{error}");
        request.buffer_longs = Some(0);
        assert!(planned(&request, None).is_err());
        request.buffer_longs = Some(u32::MAX);
        assert!(planned(&request, None).is_err());
    }

    #[test]
    fn impossible_requests_are_refused() {
        assert_eq!(
            planned(&request(&[]), None),
            Err(PlanError::Sources { count: 0, most: 24, first: 21, last: 44 })
        );
        let names: Vec<_> = (0..25).map(|n| format!("X:${n}")).collect();
        let names: Vec<_> = names.iter().map(String::as_str).collect();
        assert_eq!(
            planned(&request(&names), None),
            Err(PlanError::Sources { count: 25, most: 24, first: 21, last: 44 })
        );
        assert_eq!(planned(&request(&names[..24]), None).unwrap().registers.len(), 24);
        let twice = planned(&request(&["X:$33", "X:$0033"]), None);
        assert_eq!(twice, Err(PlanError::Twice { name: "X:$0033".to_owned() }));
        for period in [0, 8_388_608] {
            let request = GatherRequest { period, ..request(&["X:$33"]) };
            assert_eq!(planned(&request, None), Err(PlanError::Period { period, variable: 19 }));
        }
    }
}
