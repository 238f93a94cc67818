//! The geometry of an arc in X, Y, Z (Software Reference p. 295; User Manual p. 177).
//!
//! The arc lies in the plane normal to the NORMAL vector. Clockwise follows the right-hand rule about that vector,
//! which by default points to -Z. Motion along the vector is straight: a helix.

/// X, Y, Z.
pub type Vector = [f64; 3];

/// An arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc {
    /// Unit vector from the centre to the start.
    pub e1: Vector,
    /// Unit vector a quarter turn further.
    pub e2: Vector,
    /// Radius at start and end.
    pub radius: [f64; 2],
    /// Angle in radians, above 0.
    pub sweep: f64,
}

/// How the centre is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Centre {
    /// The vector from the start to the centre.
    From(Vector),
    /// The radius; negative for an arc of 180 degrees or more.
    Radius(f64),
}

/// The distance exceeds two radii by more than a spiral may make up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RadiusError;

/// Below this part of a semicircle, an arc given by its centre is a full circle, whatever I90 says.
const SMALLEST: f64 = 1e-6;

impl Arc {
    /// The arc from the start over `way`, by the right-hand rule about `axis`, which has a length. `allowed` is Ix96,
    /// `smallest` I90 in semicircles.
    ///
    /// # Errors
    /// [`RadiusError`].
    pub fn new(
        way: Vector,
        centre: Centre,
        axis: Vector,
        allowed: f64,
        smallest: f64,
    ) -> Result<Self, RadiusError> {
        let axis = scale(axis, 1.0 / dot(axis, axis).sqrt());
        let flat = |v: Vector| minus(v, scale(axis, dot(v, axis)));
        let way = flat(way);
        let centre = match centre {
            Centre::From(vector) => flat(vector),
            Centre::Radius(radius) => by_radius(way, radius, axis, allowed)?,
        };
        let start = scale(centre, -1.0);
        let end = minus(way, centre);
        let radius = [dot(start, start).sqrt(), dot(end, end).sqrt()];
        if radius[0] == 0.0 {
            return Err(RadiusError);
        }
        let e1 = scale(start, 1.0 / radius[0]);
        let e2 = cross(axis, e1);
        let turn = std::f64::consts::TAU;
        let angle = dot(end, e2).atan2(dot(end, e1)).rem_euclid(turn);
        let least = smallest.max(SMALLEST) * std::f64::consts::PI;
        let sweep = if angle < least || angle > turn - SMALLEST { turn } else { angle };
        Ok(Self { e1, e2, radius, sweep })
    }

    /// The axes at `u` (0 to 1) of the arc from `start` to `end`: X, Y and Z on the arc, the others straight.
    #[must_use]
    pub fn axes_at(&self, u: f64, start: &[f64; 9], end: &[f64; 9]) -> [f64; 9] {
        let turned = |u: f64| {
            let (sin, cos) = (self.sweep * u).sin_cos();
            let radius = self.radius[0] + (self.radius[1] - self.radius[0]) * u;
            [0, 1, 2].map(|k| radius * (cos * self.e1[k] + sin * self.e2[k]) - self.radius[0] * self.e1[k])
        };
        let (now, whole) = (turned(u), turned(1.0));
        std::array::from_fn(|axis| {
            let arc = axis.checked_sub(6);
            let (now, whole) = arc.map_or((0.0, 0.0), |k| (now[k], whole[k]));
            start[axis] + now + (end[axis] - start[axis] - whole) * u
        })
    }

    /// Its length at the mean radius.
    #[must_use]
    pub fn length(&self) -> f64 {
        (self.radius[0] + self.radius[1]) / 2.0 * self.sweep
    }
}

fn by_radius(way: Vector, radius: f64, axis: Vector, allowed: f64) -> Result<Vector, RadiusError> {
    let distance = dot(way, way).sqrt();
    if distance == 0.0 || distance - 2.0 * radius.abs() > allowed + 1e-9 * distance {
        return Err(RadiusError);
    }
    let middle = scale(way, 0.5);
    let height = (radius * radius - distance * distance / 4.0).max(0.0).sqrt().copysign(radius);
    let aside = cross(axis, scale(way, 1.0 / distance));
    Ok([0, 1, 2].map(|k| middle[k] + height * aside[k]))
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn scale(a: Vector, by: f64) -> Vector {
    a.map(|x| x * by)
}

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn axis(clockwise: bool) -> Vector {
        [0.0, 0.0, if clockwise { -1.0 } else { 1.0 }]
    }

    fn sweep(way: Vector, centre: Centre, clockwise: bool) -> Result<f64, RadiusError> {
        Arc::new(way, centre, axis(clockwise), 0.0, 0.0).map(|arc| arc.sweep / PI)
    }

    #[test]
    fn directions_and_full_circles() {
        let quarter = [10.0, 10.0, 5.0];
        let close = |a: Result<f64, RadiusError>, b: f64| (a.unwrap() - b).abs() < 1e-9;
        // A quarter circle from (0,0) round (10,0) to (10,10): clockwise as seen from above.
        assert!(close(sweep(quarter, Centre::From([10.0, 0.0, 0.0]), true), 0.5));
        assert!(close(sweep(quarter, Centre::From([10.0, 0.0, 0.0]), false), 1.5));
        assert!(close(sweep(quarter, Centre::Radius(10.0), true), 0.5));
        assert!(close(sweep(quarter, Centre::Radius(10.0), false), 0.5));
        assert!(close(sweep(quarter, Centre::Radius(-10.0), true), 1.5));
        assert!(close(sweep([0.0; 3], Centre::From([3.0, 4.0, 0.0]), true), 2.0));
        assert_eq!(sweep(quarter, Centre::Radius(5.0), true), Err(RadiusError));
        assert_eq!(sweep([0.0; 3], Centre::Radius(5.0), true), Err(RadiusError));
        let spiral = Arc::new([20.0, 0.0, 0.0], Centre::From([8.0, 0.0, 0.0]), axis(true), 0.0, 0.0).unwrap();
        assert_eq!(spiral.radius, [8.0, 12.0]);
    }

    #[test]
    fn the_end_is_where_the_way_says() {
        let way = [3.0, -7.0, 0.0];
        for clockwise in [true, false] {
            for radius in [6.0, -6.0] {
                let arc = Arc::new(way, Centre::Radius(radius), axis(clockwise), 0.0, 0.0).unwrap();
                let (sin, cos) = arc.sweep.sin_cos();
                let end = |k: usize| {
                    arc.radius[1] * (cos * arc.e1[k] + sin * arc.e2[k]) - arc.radius[0] * arc.e1[k]
                };
                assert!((end(0) - way[0]).abs() < 1e-9 && (end(1) - way[1]).abs() < 1e-9);
                assert_eq!(arc.sweep > PI, radius < 0.0);
            }
        }
    }
}
