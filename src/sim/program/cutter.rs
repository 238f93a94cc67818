//! The geometry of cutter radius compensation: where offset paths meet (CC0, CC1, CC2, CCR; I89).
//!
//! A move is offset by the radius to its left or right in the plane normal to NORMAL. Inside a corner the offset paths
//! end where they cross. Outside, an arc about the corner joins them, unless the cosine of the change of direction is
//! above I89: then they are extended until they cross. The available manual pages do not print this rule; it is usual
//! for such controls, and they document I89 as the border between its two cases.

/// A point or direction in the plane.
pub type Point = [f64; 2];

/// Below this difference, directions count as equal.
const SAME: f64 = 1e-9;

/// A programmed move in the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Element {
    /// Its end.
    pub end: Point,
    /// Its directions at the start and at the end.
    pub tangents: [Point; 2],
    /// Of an arc: its centre, and whether it turns left.
    pub turn: Option<(Point, bool)>,
}

/// How a move joins the next one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Corner {
    /// The offset paths meet here.
    Meet(Point),
    /// An arc about the corner leads from the first point to the second.
    Round(Point, Point),
}

impl Element {
    /// From `start` to `end`, straight or about a centre. `None` when it has no direction in the plane.
    #[must_use]
    pub fn new(start: Point, end: Point, turn: Option<(Point, bool)>) -> Option<Self> {
        let tangents = match turn {
            None => [unit(minus(end, start))?; 2],
            Some((centre, left)) => {
                let along = |point: Point| {
                    let [x, y] = unit(minus(point, centre))?;
                    Some(if left { [-y, x] } else { [y, -x] })
                };
                [along(start)?, along(end)?]
            }
        };
        Some(Self { end, tangents, turn })
    }

    /// Its end when it is offset by `offset` to the left.
    #[must_use]
    pub fn offset_end(&self, offset: f64) -> Point {
        plus(self.end, scaled(left_of(self.tangents[1]), offset))
    }

    /// The start of `next`, which begins at its end, when that is offset by `offset` to the left.
    #[must_use]
    pub fn offset_start_of(&self, next: &Self, offset: f64) -> Point {
        plus(self.end, scaled(left_of(next.tangents[0]), offset))
    }

    /// The corner with `next`, both `offset` to the left; `sharp` is I89. `None` when the offset paths do not cross:
    /// the cutter does not fit.
    #[must_use]
    pub fn corner(&self, next: &Self, offset: f64, sharp: f64) -> Option<Corner> {
        let (before, after) = (self.tangents[1], next.tangents[0]);
        let (cross, dot) = (cross(before, after), dot(before, after));
        if cross.abs() < SAME && dot > 0.0 {
            return Some(Corner::Meet(self.offset_end(offset)));
        }
        let outside = cross * offset < 0.0 || cross.abs() < SAME;
        if outside && dot <= sharp {
            return Some(Corner::Round(self.offset_end(offset), self.offset_start_of(next, offset)));
        }
        self.meet(next, offset).map(Corner::Meet)
    }

    /// The crossing of the offset paths nearest to the corner.
    fn meet(&self, next: &Self, offset: f64) -> Option<Point> {
        let (here, there) = (self.offset_end(offset), self.offset_start_of(next, offset));
        let radius = |element: &Self| {
            let (centre, left) = element.turn?;
            let radius = length(minus(self.end, centre)) + if left { -offset } else { offset };
            Some((centre, radius)).filter(|(_, radius)| *radius > 0.0)
        };
        let points = match (self.turn, next.turn) {
            (None, None) => {
                let along = cross(minus(there, here), next.tangents[0]);
                let t = along / cross(self.tangents[1], next.tangents[0]);
                [plus(here, scaled(self.tangents[1], t)); 2]
            }
            (None, Some(_)) => line_and_circle(here, self.tangents[1], radius(next)?)?,
            (Some(_), None) => line_and_circle(there, next.tangents[0], radius(self)?)?,
            (Some(_), Some(_)) => circles(radius(self)?, radius(next)?)?,
        };
        let off = |point: &Point| length(minus(*point, self.end));
        points.into_iter().min_by(|a, b| off(a).total_cmp(&off(b)))
    }
}

fn line_and_circle(point: Point, along: Point, (centre, radius): (Point, f64)) -> Option<[Point; 2]> {
    let way = minus(centre, point);
    let (nearest, aside) = (dot(way, along), cross(along, way));
    let half = radius * radius - aside * aside;
    let half = if half < 0.0 { return None } else { half.sqrt() };
    Some([nearest - half, nearest + half].map(|t| plus(point, scaled(along, t))))
}

fn circles((a, ra): (Point, f64), (b, rb): (Point, f64)) -> Option<[Point; 2]> {
    let way = minus(b, a);
    let distance = length(way);
    let along = unit(way)?;
    let x = (distance * distance + ra * ra - rb * rb) / (2.0 * distance);
    let height = ra * ra - x * x;
    let height = if height < 0.0 { return None } else { height.sqrt() };
    Some([-height, height].map(|y| plus(plus(a, scaled(along, x)), scaled(left_of(along), y))))
}

/// `v` turned a quarter to the left.
fn left_of([x, y]: Point) -> Point {
    [-y, x]
}

/// The unit vector in the direction of `v`.
fn unit(v: Point) -> Option<Point> {
    let size = length(v);
    (size > SAME).then(|| scaled(v, 1.0 / size))
}

fn length(v: Point) -> f64 {
    v[0].hypot(v[1])
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn plus(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1]]
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

fn scaled(a: Point, by: f64) -> Point {
    a.map(|x| x * by)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(start: Point, end: Point) -> Element {
        Element::new(start, end, None).unwrap()
    }

    #[track_caller]
    fn meets(corner: Option<Corner>, [x, y]: Point) {
        let Some(Corner::Meet(found)) = corner else { panic!("{corner:?}") };
        assert!((found[0] - x).abs() < 1e-9 && (found[1] - y).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn corners_of_lines_and_arcs() {
        let right = line([0.0, 0.0], [10.0, 0.0]);
        let up = line([10.0, 0.0], [10.0, 10.0]);
        meets(right.corner(&up, 1.0, 0.9998), [9.0, 1.0]);
        assert_eq!(right.corner(&up, -1.0, 0.9998), Some(Corner::Round([10.0, -1.0], [11.0, 0.0])));
        meets(right.corner(&up, -1.0, -1.0), [11.0, -1.0]);
        meets(right.corner(&line([10.0, 0.0], [20.0, 0.0]), 1.0, 0.9998), [10.0, 1.0]);
        let back = line([10.0, 0.0], [0.0, 0.0]);
        assert_eq!(right.corner(&back, 1.0, 0.9998), Some(Corner::Round([10.0, 1.0], [10.0, -1.0])));
        // An arc about (10, 5) to the left: tangent. And one about (15, 0) that goes up and is entered at an angle.
        let tangent = Element::new([10.0, 0.0], [15.0, 5.0], Some(([10.0, 5.0], true))).unwrap();
        meets(right.corner(&tangent, 1.0, 0.9998), [10.0, 1.0]);
        assert_eq!(tangent.offset_end(1.0), [14.0, 5.0]);
        let steep = Element::new([10.0, 0.0], [15.0, 5.0], Some(([15.0, 0.0], false))).unwrap();
        meets(right.corner(&steep, 1.0, 0.9998), [15.0 - 35f64.sqrt(), 1.0]);
        let other = Element::new([15.0, 5.0], [20.0, 10.0], Some(([15.0, 10.0], true))).unwrap();
        meets(steep.corner(&other, 1.0, 0.9998), [15.0, 6.0]);
        // The cutter is larger than the arc.
        assert_eq!(
            up.corner(&Element::new([10.0, 10.0], [9.0, 9.0], Some(([10.0, 9.0], true))).unwrap(), 2.0, 1.0),
            None
        );
        assert_eq!(Element::new([1.0, 1.0], [1.0, 1.0], None), None);
    }
}
