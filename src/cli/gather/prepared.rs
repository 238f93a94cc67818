//! A gather before its begin: the sources, and whether board and daemon can gather them.

use crate::cli::context::{Context, Failure};
use crate::cli::layout::board_layout;
use crate::client::{Board, Connection, GatherRun, identity};
use crate::gather::{GatherMode, GatherPlan, GatherRequest, SampleClock, Source, SourceError, plan};
use crate::map::{BufferLayout, DEFAULT_FAMILY, Family, Layout};
use crate::protocol::{BoardSettings, Function};

/// A gather that has not begun.
pub struct Prepared {
    pub board: Board,
    /// The owner of the gather, from [`Prepared::begin`] on.
    pub connection: Connection,
    pub layout: Layout,
    pub plan: GatherPlan,
    pub clock: SampleClock,
}

impl Prepared {
    /// A gather of the `sources` on the board; `buffer` longs, or all that the daemon reserves. Sends no line yet.
    ///
    /// # Errors
    /// [`Failure`] says what board or daemon cannot gather.
    pub fn new(
        context: &Context,
        sources: impl FnOnce(&Layout) -> Result<Vec<Source>, SourceError>,
        period: u32,
        mode: GatherMode,
        buffer: Option<u32>,
    ) -> Result<Self, Failure> {
        let mut board = context.board()?;
        let mut connection = context.connection()?;
        let settings = connection.settings()?;
        let family = identity::family(&board.identity()?).unwrap_or(DEFAULT_FAMILY);
        check_functions(&settings, family, &[Function::Gather, Function::Ascii])?;
        let (layout, scales, firmware) = board_layout(&mut board)?;
        // The segment tells the family, but not how much DPRAM the board has.
        let layout = settings.layout(connection.info()?.sized(layout.family()), firmware);
        let sources = sources(&layout).map_err(Failure::request)?;
        let sample_longs = sources.iter().map(Source::longs).sum();
        let kept = BufferLayout::new(&layout, &settings.plan).map_err(Failure::request)?;
        let buffer_longs = buffer.or_else(|| kept.gather_size(sample_longs));
        let request = GatherRequest { sources, period, mode, buffer_longs };
        let plan = plan(&request, &layout, &scales).map_err(Failure::request)?;
        kept.check_gather(layout.gather().buffer, plan.buffer_longs, plan.sample_longs)
            .map_err(Failure::request)?;
        let clock = SampleClock { period: plan.period, servo_period_ns: scales.servo_period_ns() };
        Ok(Self { board, connection, layout, plan, clock })
    }

    /// Begins the gather; returns when the board gathers.
    ///
    /// # Errors
    /// [`Failure`]. The board is then in its state before the call.
    pub fn begin(&mut self) -> Result<GatherRun, Failure> {
        let Self { board, connection, layout, plan, clock } = self;
        let follower = board.follow_gather()?;
        let servo_period_ns = clock.servo_period_ns.map(|ns| ns.round() as u64);
        connection.gather_start(plan, layout, servo_period_ns)?;
        Ok(GatherRun::new(follower, plan.columns.clone()))
    }
}

/// Checks the functions that a gather needs, before sending anything to the board.
fn check_functions(settings: &BoardSettings, family: &Family, needed: &[Function]) -> Result<(), Failure> {
    match needed.iter().find(|function| !settings.functions.has(**function)) {
        Some(function) => {
            Err(Failure::Refused(format!("cannot gather: {}", settings.functions.why_not(*function, family))))
        }
        None => Ok(()),
    }
}
