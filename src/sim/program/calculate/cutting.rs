//! Cutter radius compensation in a running program: each move is held back until the next one determines its corner
//! (Software Reference, CC0, CC1, CC2, CCR).
//!
//! It acts on LINEAR and CIRCLE moves while I13>0. The first move after CC1 or CC2 leads in: straight to the point
//! beside the start of the next move. The first move after CC0 leads out: straight from the point beside the end of the
//! last one. A dwell, a stop, another move mode or the end of the buffer ends a held move beside its own end. Where the
//! cutter does not fit, the program stops with a run-time error and bit 10 of PSTATUS.

use crate::sim::program::calculate::Calculator;
use crate::sim::program::circle::Centre;
use crate::sim::program::cutter::{Corner, Element, Point};
use crate::sim::program::cutter_state::Held;
use crate::sim::program::item::{Data, Mode};
use crate::sim::program::system::Failure;
use crate::sim::program::transform::Vector;

/// Index of X; Y and Z follow.
const X: usize = 6;
/// PSTATUS: outside corner, stop request, move held.
const OUTSIDE: u32 = 1 << 11;
const STOP_REQUEST: u32 = 1 << 10;
const HELD: u32 = 1 << 9;

/// The plane of compensation: two directions in it.
#[derive(Clone, Copy)]
struct Plane([Vector; 2]);

impl Plane {
    fn new(normal: Vector) -> Self {
        let size = dot(normal, normal).sqrt();
        let up = if size > 0.0 { normal.map(|x| -x / size) } else { [0.0, 0.0, 1.0] };
        let first = if up[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let aside: Vector = std::array::from_fn(|k| first[k] - up[k] * dot(first, up));
        let size = dot(aside, aside).sqrt();
        let u = aside.map(|x| x / size);
        let v = [up[1] * u[2] - up[2] * u[1], up[2] * u[0] - up[0] * u[2], up[0] * u[1] - up[1] * u[0]];
        Self([u, v])
    }

    fn point(self, position: Vector) -> Point {
        self.0.map(|direction| dot(position, direction))
    }

    /// `axes` with their position in the plane replaced by `point`.
    fn moved(self, axes: &[f64; 9], point: Point) -> [f64; 9] {
        let now = self.point(three(axes));
        let mut moved = *axes;
        for k in 0..3 {
            moved[X + k] += (point[0] - now[0]) * self.0[0][k] + (point[1] - now[1]) * self.0[1][k];
        }
        moved
    }
}

impl Calculator<'_> {
    /// `CC0`, `CC1` (left), `CC2` (right).
    pub(super) fn cutter_side(&mut self, side: u8) {
        let side = [0.0, 1.0, -1.0].get(usize::from(side)).copied().unwrap_or(0.0);
        let cutter = &mut self.system.cutter;
        if side == cutter.side {
            return;
        }
        if side == 0.0 || cutter.side == 0.0 {
            self.finish_cutting();
            self.system.cutter.leads_in = side != 0.0;
        }
        self.system.cutter.side = side;
    }

    /// `CCR`.
    pub(super) fn cutter_radius(&mut self, radius: &Data) {
        self.system.cutter.radius = self.value(radius);
    }

    /// A programmed LINEAR or CIRCLE move to `axes`.
    pub(super) fn travel(&mut self, centre: Option<Centre>, axes: [f64; 9]) {
        if self.system.cutter.side == 0.0 || !self.segmented() {
            self.go(centre, axes);
            self.system.cutter.programmed = None;
            return;
        }
        let plane = self.plane();
        let start = self.programmed();
        let centre = match centre {
            None => None,
            Some(Centre::From(vector)) => Some(vector),
            Some(radius) => match self.geometry(&start, &axes, radius) {
                Some(arc) => Some(arc.e1.map(|x| -x * arc.radius[0])),
                None => return,
            },
        };
        let centre = centre.map(|vector| -> Vector { std::array::from_fn(|k| start[X + k] + vector[k]) });
        let turn = centre.map(|centre| (plane.point(centre), self.system.mode == Mode::Circle2));
        let element = Element::new(plane.point(three(&start)), plane.point(three(&axes)), turn);
        let Some(element) = element else {
            // It leaves the plane, or moves only other axes: the cutter stays beside the path.
            self.finish_cutting();
            let beside = self.system.axes;
            let mut target = axes;
            for k in X..9 {
                target[k] = beside[k] + axes[k] - start[k];
            }
            self.go(None, target);
            self.system.cutter.programmed = Some(axes);
            return;
        };
        if let Some(held) = self.system.cutter.held.take() {
            self.release(held, Some(&element));
        }
        let leads_in = std::mem::take(&mut self.system.cutter.leads_in);
        if leads_in && centre.is_some() {
            self.system.failure = Some(Failure::RunTime);
            return;
        }
        self.system.cutter.held = Some(Held {
            element,
            end: axes,
            centre,
            leads_in,
            mode: self.system.mode,
            cursor: self.system.cursor,
            later: std::mem::take(&mut self.system.later),
            times: [87, 88, 89].map(|n| self.ix(n)),
            by_time: self.board.coordinate_status(self.cs)[0] & 1 << 3,
        });
        self.system.cutter.programmed = Some(axes);
        self.board.program_word(self.cs, 0, HELD);
    }

    /// Ends a held move beside its own end.
    pub(super) fn finish_cutting(&mut self) {
        if let Some(held) = self.system.cutter.held.take() {
            self.release(held, None);
        }
    }

    fn plane(&self) -> Plane {
        Plane::new(self.system.normal.unwrap_or([0.0, 0.0, -1.0]))
    }

    /// Makes the held move, up to its corner with `next`, with its programmed times and mode.
    fn release(&mut self, mut held: Held, next: Option<&Element>) {
        self.board.program_word(self.cs, HELD | OUTSIDE, 0);
        let times = [87, 88, 89].map(|n| self.ix(n));
        let by_time = self.board.coordinate_status(self.cs)[0] & 1 << 3;
        self.set_times(held.times, held.by_time);
        let mode = std::mem::replace(&mut self.system.mode, held.mode);
        let cursor = std::mem::replace(&mut self.system.cursor, held.cursor);
        let later = std::mem::replace(&mut self.system.later, std::mem::take(&mut held.later));
        if !self.cut(&held, next) {
            self.board.program_word(self.cs, 0, STOP_REQUEST);
            self.system.failure = Some(Failure::RunTime);
        }
        (self.system.mode, self.system.cursor, self.system.later) = (mode, cursor, later);
        self.set_times(times, by_time);
    }

    fn set_times(&mut self, times: [f64; 3], by_time: u32) {
        for (n, time) in [87, 88, 89].into_iter().zip(times) {
            self.set_ix(n, time);
        }
        self.board.coordinate_word(self.cs, 1 << 3, by_time);
    }

    /// Makes the held move along its offset path; returns whether the cutter fits.
    fn cut(&mut self, held: &Held, next: Option<&Element>) -> bool {
        let plane = self.plane();
        let offset = self.system.cutter.side * self.system.cutter.radius;
        let sharp = self.board.setting(self.board.settings().corner_break, self.cs);
        let element = &held.element;
        let corner = match next {
            None => Some(Corner::Meet(element.offset_end(offset))),
            Some(next) if held.leads_in => Some(Corner::Meet(element.offset_start_of(next, offset))),
            Some(next) => element.corner(next, offset, sharp),
        };
        let (end, round) = match corner {
            Some(Corner::Meet(end)) => (end, None),
            Some(Corner::Round(end, round)) => (end, Some(round)),
            None => return false,
        };
        let axes = plane.moved(&held.end, end);
        let from = self.system.axes;
        match held.centre {
            None => {
                let start = plane.point(three(&from));
                let way = [end[0] - start[0], end[1] - start[1]];
                let forward = way[0] * element.tangents[1][0] + way[1] * element.tangents[1][1];
                if !held.leads_in && forward < -1e-9 {
                    return false;
                }
                self.go(None, axes);
            }
            Some(centre) => {
                let vector: Vector = std::array::from_fn(|k| centre[k] - from[X + k]);
                self.go(Some(Centre::From(vector)), axes);
            }
        }
        if let Some(round) = round {
            self.board.program_word(self.cs, 0, OUTSIDE);
            self.system.mode = if offset > 0.0 { Mode::Circle1 } else { Mode::Circle2 };
            let vector: Vector = std::array::from_fn(|k| held.end[X + k] - axes[X + k]);
            self.go(Some(Centre::From(vector)), plane.moved(&held.end, round));
        }
        true
    }
}

fn three(axes: &[f64; 9]) -> Vector {
    [axes[X], axes[X + 1], axes[X + 2]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
