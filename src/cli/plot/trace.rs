//! From a column of values to lines on the page: broken at missing values, and with only as many of a million points as
//! the eye can see.

/// Points of one line, and places of values that stand alone.
#[derive(Debug, Default, PartialEq)]
pub struct Drawn {
    pub lines: Vec<Vec<[f64; 2]>>,
    pub dots: Vec<[f64; 2]>,
}

impl Drawn {
    fn end(&mut self, run: &mut Vec<[f64; 2]>) {
        match run[..] {
            [] => {}
            [dot] => self.dots.push(dot),
            _ => self.lines.push(thinned(run)),
        }
        run.clear();
    }
}

/// The points, each on the page or missing, as lines. `gaps` has the indices, ascending, of points that follow missing
/// points.
pub fn drawn(points: impl Iterator<Item = Option<[f64; 2]>>, gaps: &[usize]) -> Drawn {
    let mut drawn = Drawn::default();
    let mut run = Vec::new();
    for (index, point) in points.enumerate() {
        if gaps.binary_search(&index).is_ok() {
            drawn.end(&mut run);
        }
        match point {
            Some(point) => run.push(point),
            None => drawn.end(&mut run),
        }
    }
    drawn.end(&mut run);
    drawn
}

/// Of each column of pixels the first, the lowest, the highest and the last point: these four look like all points.
fn thinned(run: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut kept: Vec<[f64; 2]> = Vec::new();
    for column in run.chunk_by(|one, other| one[0].floor() == other[0].floor()) {
        let by_height = |one: &&[f64; 2], other: &&[f64; 2]| one[1].total_cmp(&other[1]);
        let extremes = (column.iter().min_by(by_height), column.iter().max_by(by_height));
        let (Some(first), Some(last), (Some(low), Some(high))) = (column.first(), column.last(), extremes)
        else {
            continue;
        };
        if column.len() <= 4 {
            kept.extend(column);
        } else {
            kept.extend([first, low, high, last]);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_values_break_the_line_and_a_lone_one_is_a_dot() {
        let points = [
            Some([0.0, 1.0]),
            Some([1.0, 1.0]),
            Some([2.0, 2.0]),
            None,
            None,
            Some([4.0, 3.0]),
            None,
            Some([6.0, 0.0]),
        ];
        let Drawn { lines, dots } = drawn(points.into_iter(), &[1]);
        assert_eq!(lines, [vec![[1.0, 1.0], [2.0, 2.0]]]);
        assert_eq!(dots, [[0.0, 1.0], [4.0, 3.0], [6.0, 0.0]]);
        assert_eq!(drawn(std::iter::empty(), &[]), Drawn::default());
    }

    #[test]
    fn of_a_million_points_the_spike_is_kept() {
        let height = |index: usize| if index == 777_777 { 100.0 } else { (index % 7) as f64 };
        let points = (0..1_000_000).map(|index| Some([index as f64 / 1000.0, height(index)]));
        let Drawn { lines, .. } = drawn(points, &[]);
        assert!(lines.len() == 1 && lines[0].len() == 4000, "{}", lines[0].len());
        assert!(lines[0].iter().any(|point| point[1] == 100.0));
    }
}
