//! From the words of a line to a move: targets, times, limits (Software Reference pp. 75, 121-122, 318; User Manual
//! pp. 166-183, 274).

use crate::sim::board::motor::{MOST_MOTORS, Motors, STILL};
use crate::sim::board::variables::VariableKind;
use crate::sim::program::calculate::Calculator;
use crate::sim::program::circle::{self, Centre};
use crate::sim::program::item::{Mode, Time, Transform};
use crate::sim::program::path::{Arc, Blend, Path, Ramp};
use crate::sim::program::place::Cursor;
use crate::sim::program::spline::{Spline, cubic};
use crate::sim::program::system::Failure;
use crate::sim::program::trajectory::{Entry, Jog, Shape};
use crate::sim::program::transform::Vector;

/// Index of X; Y and Z follow.
const X: usize = 6;
/// The longest move in ms.
const LONGEST: f64 = 8_388_607.0;
/// Replaces TA and TS of zero, which are not allowed, in ms.
const SHORTEST: f64 = 1.0;

impl Calculator<'_> {
    pub(super) fn set_mode(&mut self, mode: Mode) {
        if mode != self.system.mode {
            self.end_spline();
        }
        self.system.mode = mode;
        self.board.program_word(self.cs, 0b1_0011, mode.status());
    }

    pub(super) fn set_ix(&mut self, n: usize, value: f64) {
        let number = self.board.variables.tables().coordinate_i(self.cs, n);
        self.board.variables.set_i(number, value);
    }

    pub(super) fn set_time(&mut self, time: Time, value: f64) {
        let value = value.round().clamp(0.0, LONGEST);
        match time {
            Time::Acceleration => {
                if self.system.mode == Mode::Spline1 && value != self.ix(87) {
                    self.end_spline();
                }
                self.set_ix(87, value);
            }
            Time::SCurve => self.set_ix(88, value),
            Time::Move => {
                self.set_ix(89, value);
                self.board.coordinate_word(self.cs, 1 << 3, 1 << 3);
            }
        }
    }

    fn ramp(&self) -> Ramp {
        let (ta, ts) = (self.ix(87), self.ix(88));
        Ramp { time: ta.max(2.0 * ts).max(SHORTEST), s_time: ts }
    }

    fn entry(&mut self, shape: Shape, target: Motors, axes: [f64; 9]) -> Entry {
        let cursor = self.system.cursor.unwrap_or(Cursor::at(0, 0));
        let offset = self.programs.offset(self.cs, Cursor { item: 0, ..cursor });
        Entry {
            shape,
            start: 0.0,
            target,
            axes,
            mode: self.system.mode,
            segmented: self.segmented(),
            joined: false,
            closed: false,
            started: false,
            later: std::mem::take(&mut self.system.later),
            origin: (cursor.program, cursor.line, offset),
        }
    }

    fn append(&mut self, shape: Shape, target: Motors, axes: [f64; 9]) {
        let entry = self.entry(shape, target, axes);
        let delay = self.board.variables.i(11);
        self.system.trajectory.append(entry, delay);
        self.system.axes = axes;
        self.system.moved = true;
        if self.ix(92) == 1.0 {
            self.system.trajectory.close();
        }
    }

    pub(super) fn dwell(&mut self, time: f64) {
        self.end_spline();
        let (target, axes) = (self.system.trajectory.target(), self.system.axes);
        self.append(Shape::Dwell(time.clamp(0.0, LONGEST)), target, axes);
        self.board.program_word(self.cs, 1 << 12, 1 << 12);
    }

    /// A blended move of zero distance.
    pub(super) fn delay(&mut self, time: f64) {
        self.end_spline();
        let (target, axes) = (self.system.trajectory.target(), self.system.axes);
        self.blend(Path::Line(Box::new(STILL)), time.clamp(0.0, LONGEST), target, axes);
    }

    pub(super) fn home(&mut self, motors: u32) {
        self.end_spline();
        let (target, axes) = (self.system.trajectory.target(), self.system.axes);
        self.append(Shape::Home(motors), target, axes);
        self.system.rematch = true;
    }

    pub(super) fn home_zero(&mut self, motors: u32) {
        for motor in (0..self.board.motors.len()).filter(|motor| motors >> motor & 1 == 1) {
            self.board.home_here(motor);
        }
        self.system.rematch = true;
        self.match_positions();
    }

    pub(super) fn position_set(&mut self, axes: [f64; 9]) {
        self.match_positions();
        self.board.set_axes(self.cs, &axes);
        self.system.axes = axes;
    }

    /// At rest: takes the axis positions from the motors, if the motors have moved independently.
    pub(super) fn match_positions(&mut self) {
        if std::mem::take(&mut self.system.rematch) {
            let mut axes = self.system.axes;
            if !self.programs.axis_positions(self.board, self.cs, &mut axes) {
                self.system.failure = Some(Failure::RunTime);
            }
            self.system.axes = axes;
            self.system.trajectory.reset(self.board.commanded());
        }
    }

    pub(super) fn transform(&mut self, transform: Transform, first: usize) {
        let count = self.board.variables.tables().variables;
        let q = |k: usize| self.board.value(VariableKind::Q, self.cs, (first + k).min(count - 1));
        let three = [q(0), q(1), q(2)];
        let nine = std::array::from_fn(q);
        let Some(matrix) = self.system.transformations.selected_mut() else { return };
        match transform {
            Transform::AbsoluteDisplacement => matrix.displace(three, false),
            Transform::IncrementalDisplacement => matrix.displace(three, true),
            Transform::AbsoluteRotation => matrix.rotate(nine, false),
            Transform::IncrementalRotation => matrix.rotate(nine, true),
        }
    }

    /// Makes the line's move, if any.
    pub(super) fn make_move(&mut self) {
        if self.system.request.is_empty() {
            self.system.request = Default::default();
            return;
        }
        self.match_positions();
        let request = std::mem::take(&mut self.system.request);
        let axes = self.target(&request.axes);
        let arc = matches!(self.system.mode, Mode::Circle1 | Mode::Circle2)
            && (request.radius.is_some() || request.vectors.iter().any(Option::is_some));
        if arc && !self.segmented() {
            let variable = self.board.variable_of(self.board.settings().segmentation, self.cs);
            let cs = self.cs + 1;
            self.board.note(format!(
                "coordinate system {cs} moves along the chord, not the circle: I{variable} is 0"
            ));
        }
        match self.system.mode {
            Mode::Circle1 | Mode::Circle2 if arc && self.segmented() => {
                let centre = match request.radius {
                    Some(radius) => Centre::Radius(radius),
                    None => Centre::From(self.centre(&request.vectors)),
                };
                self.go(Some(centre), axes);
            }
            Mode::Linear | Mode::Circle1 | Mode::Circle2 => self.go(None, axes),
            Mode::Rapid => self.rapid(&request.triggers, axes),
            Mode::Spline1 | Mode::Spline2 => {
                let from = self.system.trajectory.target();
                let time = self.ix(87).max(SHORTEST);
                if self.system.spline.is_none() {
                    self.system.trajectory.close();
                }
                let point = self.targets(&axes, &from);
                let spline = self.system.spline.get_or_insert_with(|| Spline::new(from, time));
                let (segment, end) = spline.next(point, time);
                self.append(segment, end, axes);
            }
            Mode::Pvt => {
                let from = self.system.trajectory.target();
                let time = self.ix(87).max(SHORTEST);
                let given =
                    std::array::from_fn(|axis| request.axes[axis].map_or(0.0, |_| request.velocities[axis]));
                let [target, after] = self.targets_and_velocities(&axes, Some(&given), &from);
                let per_ms = 1.0 / self.ix(90).max(f64::MIN_POSITIVE);
                let after = after.map(|velocity| velocity * per_ms);
                let before = self.system.velocities;
                if self.system.trajectory.entries().last().is_none_or(|last| last.mode != Mode::Pvt) {
                    self.system.trajectory.close();
                }
                self.append(cubic(time, &from, &target, &before, &after), target, axes);
                self.system.velocities = after;
            }
        }
    }

    /// Ends a spline in progress: its last point counts twice more. PVT ends at its last point.
    pub(super) fn end_spline(&mut self) {
        self.system.velocities = STILL;
        let Some(mut spline) = self.system.spline.take() else { return };
        let axes = self.system.axes;
        let from = self.system.trajectory.target();
        let point = self.targets(&axes, &from);
        for _ in 0..2 {
            let (segment, end) = spline.next(point, spline.time());
            self.append(segment, end, axes);
        }
    }

    /// The axes' target: modes ABS and INC and the transformation applied.
    fn target(&self, given: &[Option<f64>; 9]) -> [f64; 9] {
        let status = self.board.coordinate_status(self.cs)[0];
        let incremental = |axis: usize| status >> (6 + 2 * axis) & 1 == 1;
        let matrix = self.system.transformations.selected();
        let mut axes = self.system.axes;
        if let Some(matrix) = matrix {
            let programmed = matrix.programmed(three(&axes));
            axes[X..].copy_from_slice(&programmed);
        }
        for (axis, value) in given.iter().enumerate() {
            if let Some(value) = value {
                axes[axis] = if incremental(axis) { axes[axis] + value } else { *value };
            }
        }
        if let Some(matrix) = matrix {
            let base = matrix.base(three(&axes));
            axes[X..].copy_from_slice(&base);
        }
        axes
    }

    /// The vector from the start to the centre of an arc.
    fn centre(&self, vectors: &[Option<f64>; 3]) -> Vector {
        let given = vectors.map(|value| value.unwrap_or(0.0));
        let incremental = self.board.coordinate_status(self.cs)[0] >> 5 & 1 == 1;
        let matrix = self.system.transformations.selected().copied().unwrap_or_default();
        if incremental {
            return matrix.turned(given);
        }
        let start = three(&self.system.axes);
        let centre = matrix.base(given);
        [0, 1, 2].map(|k| if vectors[k].is_some() { centre[k] - start[k] } else { 0.0 })
    }

    /// The distance along the feedrate axes.
    fn distance(&self, axes: &[f64; 9]) -> f64 {
        let status = self.board.coordinate_status(self.cs)[0];
        let squares = (0..9).filter(|axis| status >> (7 + 2 * axis) & 1 == 1);
        squares.map(|axis| (axes[axis] - self.system.axes[axis]).powi(2)).sum::<f64>().sqrt()
    }

    /// The time in ms for `distance` at the feedrate, or TM.
    fn move_time(&self, distance: f64) -> f64 {
        let speed = self.ix(89);
        if self.board.coordinate_status(self.cs)[0] >> 3 & 1 == 1 {
            return speed.round();
        }
        if distance == 0.0 {
            return 0.0;
        }
        if speed > 0.0 { (distance * self.ix(90) / speed).min(LONGEST) } else { LONGEST }
    }

    /// Moves from the axes' position to `axes`, straight or in an arc.
    fn go(&mut self, centre: Option<Centre>, axes: [f64; 9]) {
        if let Some(centre) = centre {
            return self.arc(centre, axes);
        }
        let time = self.move_time(self.distance(&axes));
        if self.follows_curve() {
            let start = self.system.axes;
            return self.curve(|u| std::array::from_fn(|k| start[k] + (axes[k] - start[k]) * u), time, axes);
        }
        let from = self.system.trajectory.target();
        let target = self.targets(&axes, &from);
        self.blend(Path::Line(Box::new(difference(&target, &from))), time, target, axes);
    }

    /// Moves in an arc; if no arc fits, the program fails.
    fn arc(&mut self, centre: Centre, axes: [f64; 9]) {
        let way = [X, X + 1, X + 2].map(|k| axes[k] - self.system.axes[k]);
        let normal = self.system.normal.filter(|normal| *normal != [0.0; 3]).unwrap_or([0.0, 0.0, -1.0]);
        let direction = if self.system.mode == Mode::Circle1 { 1.0 } else { -1.0 };
        let axis = normal.map(|k| k * direction);
        let smallest = self.board.setting(self.board.settings().minimum_arc, self.cs);
        let Ok(arc) = circle::Arc::new(way, centre, axis, self.ix(96), smallest) else {
            self.system.failure = Some(Failure::CircleRadius);
            return;
        };
        let time = self.move_time(arc.length());
        if self.follows_curve() {
            let start = self.system.axes;
            return self.curve(|u| arc.axes_at(u, &start, &axes), time, axes);
        }
        let from = self.system.trajectory.target();
        let target = self.targets(&axes, &from);
        let vector = |v: Vector| {
            let mut axes = [0.0; 9];
            axes[X..].copy_from_slice(&v);
            self.board.motor_vector(self.cs, &axes)
        };
        let (e1, e2) = (vector(arc.e1), vector(arc.e2));
        // Axes outside the arc move straight.
        let (sin, cos) = arc.sweep.sin_cos();
        let straight: Motors = std::array::from_fn(|m| {
            let turned = arc.radius[1] * (cos * e1[m] + sin * e2[m]) - arc.radius[0] * e1[m];
            target[m] - from[m] - turned
        });
        let path = Path::Arc(Box::new(Arc { e1, e2, radius: arc.radius, sweep: arc.sweep, straight }));
        self.blend(path, time, target, axes);
    }

    /// Whether the motors' way is another than the axes', so that the inverse kinematic program makes the motors' segment by segment.
    fn follows_curve(&self) -> bool {
        self.segmented() && !self.board.kinematic_motors(self.cs).is_empty()
    }

    /// A blended move of `time` ms to `axes`, which are at `at(u)` on the way, for `u` from 0 to 1. Where the move
    /// blends with another, the ways of the motors blend.
    fn curve(&mut self, at: impl Fn(f64) -> [f64; 9], time: f64, axes: [f64; 9]) {
        /// The most segments; segments of a longer move take longer than Isx13.
        const MOST: f64 = 4096.0;
        let from = self.system.trajectory.target();
        let segment = self.board.setting(self.board.settings().segmentation, self.cs);
        let count = (time.max(self.ramp().time) / segment).ceil().clamp(1.0, MOST);
        let (mut target, mut points) = (from, vec![STILL]);
        for index in 1..=count as usize {
            target = self.targets(&at(index as f64 / count), &from);
            points.push(difference(&target, &from));
        }
        self.blend(Path::Points(points.into()), time, target, axes);
    }

    /// The motors' positions with the axes at `axes`; motors of other coordinate systems stay at `from`. Without an
    /// answer the program fails.
    fn targets(&mut self, axes: &[f64; 9], from: &Motors) -> Motors {
        self.targets_and_velocities(axes, None, from)[0]
    }

    fn targets_and_velocities(
        &mut self,
        axes: &[f64; 9],
        velocities: Option<&[f64; 9]>,
        from: &Motors,
    ) -> [Motors; 2] {
        let found = self.programs.motor_targets(self.board, self.cs, axes, velocities, from);
        found.unwrap_or_else(|| {
            self.system.failure = Some(Failure::RunTime);
            [*from, STILL]
        })
    }

    /// A blended move of `time` ms, longer if ramps or limits require it.
    fn blend(&mut self, path: Path, time: f64, target: Motors, axes: [f64; 9]) {
        let ramp = self.ramp();
        let mut time = time.max(ramp.time);
        let (mut up, mut down) = (ramp, ramp);
        if !self.segmented() {
            // Ix16 and Ix17 do not limit segmented moves.
            let way = path.velocity(0.0, 1.0);
            let limit = |motor: usize, n: usize| self.board.ix(motor, n);
            for (motor, way) in way.iter().enumerate().filter(|(_, way)| **way != 0.0) {
                let fastest = limit(motor, 16);
                if fastest > 0.0 {
                    time = time.max(way.abs() / fastest);
                }
            }
            let before = self.system.trajectory.open_velocity().unwrap_or(STILL);
            let stretched = |change: &dyn Fn(usize) -> f64| {
                let mut factor = 1.0f64;
                for motor in 0..way.len() {
                    let (change, most) = (change(motor).abs(), limit(motor, 17));
                    if change > 0.0 && most > 0.0 {
                        factor = factor.max(change / (ramp.time - ramp.s_time) / most);
                    }
                }
                ramp.within(ramp.time * factor)
            };
            up = stretched(&|motor| way[motor] / time - before[motor]);
            down = stretched(&|motor| way[motor] / time);
            time = time.max(up.time).max(down.time);
        }
        self.append(Shape::Blend(Blend { path, time, up, down }), target, axes);
    }

    /// Each motor moves by itself; the slowest determines the time.
    fn rapid(&mut self, triggers: &[Option<f64>; 9], axes: [f64; 9]) {
        self.system.trajectory.close();
        let from = self.system.trajectory.target();
        let target = self.targets(&axes, &from);
        let mut slowest = 0.0f64;
        let way = difference(&target, &from);
        let speed = |motor: usize| {
            let fastest = self.board.setting(self.board.settings().rapid_speed, motor) == 1.0;
            self.board.ix(motor, if fastest { 16 } else { 22 }).abs()
        };
        for motor in (0..way.len()).filter(|&motor| way[motor] != 0.0 && speed(motor) > 0.0) {
            slowest = slowest.max(way[motor].abs() / speed(motor));
        }
        let mut jogs = Box::new([None; MOST_MOTORS]);
        for (axis, trigger) in triggers.iter().enumerate() {
            let mut after = [0.0; 9];
            after[axis] = trigger.unwrap_or(0.0);
            let after = self.board.motor_vector(self.cs, &after);
            for motor in self.board.motors_on(self.cs, axis) {
                if slowest > 0.0 && (way[motor] != 0.0 || trigger.is_some()) {
                    let speed = if way[motor] == 0.0 { speed(motor) } else { way[motor].abs() / slowest };
                    let after = trigger.map(|_| after[motor]);
                    let jog = Jog { target: target[motor], speed, after_trigger: None };
                    let jog = jogs[motor].get_or_insert(jog);
                    jog.after_trigger = jog.after_trigger.or(after);
                }
            }
        }
        // No axis definition names these motors.
        for motor in self.board.kinematic_motors(self.cs) {
            if slowest > 0.0 && way[motor] != 0.0 {
                let speed = way[motor].abs() / slowest;
                jogs[motor] = Some(Jog { target: target[motor], speed, after_trigger: None });
            }
        }
        self.system.rematch |= triggers.iter().any(Option::is_some);
        self.append(Shape::Rapid(jogs), target, axes);
    }
}

fn three(axes: &[f64; 9]) -> Vector {
    [axes[X], axes[X + 1], axes[X + 2]]
}

fn difference(a: &Motors, b: &Motors) -> Motors {
    std::array::from_fn(|motor| a[motor] - b[motor])
}
