//! Axis transformations: `TSELECT`, `TINIT`, `ADIS`, `AROT`, `IDIS`, `IROT` (Software Reference, program commands).
//!
//! A matrix rotates and scales programmed X, Y, Z and displaces them: base = M * programmed + D. `DEFINE TBUF` sets the
//! number of matrices.

/// Three numbers for X, Y, Z.
pub type Vector = [f64; 3];

/// One transformation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matrix {
    rotation: [Vector; 3],
    displacement: Vector,
}

impl Default for Matrix {
    fn default() -> Self {
        Self { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], displacement: [0.0; 3] }
    }
}

impl Matrix {
    /// The direction `v` in base coordinates.
    #[must_use]
    pub fn turned(&self, v: Vector) -> Vector {
        self.rotation.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
    }

    /// The position `v` in base coordinates.
    #[must_use]
    pub fn base(&self, v: Vector) -> Vector {
        let turned = self.turned(v);
        [0, 1, 2].map(|k| turned[k] + self.displacement[k])
    }

    /// The programmed position of a base position; the same position when the matrix is singular.
    #[must_use]
    pub fn programmed(&self, v: Vector) -> Vector {
        let m = &self.rotation;
        let w = [0, 1, 2].map(|k| v[k] - self.displacement[k]);
        let minor = |r: usize, c: usize| {
            let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
            m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
        };
        let determinant: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
        if determinant == 0.0 {
            return v;
        }
        [0, 1, 2].map(|c| (0..3).map(|r| minor(r, c) * w[r]).sum::<f64>() / determinant)
    }

    /// `ADIS`, or `IDIS`, which adds to the present displacement.
    pub fn displace(&mut self, by: Vector, incremental: bool) {
        self.displacement = if incremental { self.base(by) } else { by };
    }

    /// `AROT`, or `IROT`, which adds to the present rotation; nine numbers, row by row.
    pub fn rotate(&mut self, by: [f64; 9], incremental: bool) {
        let mut rotation = [[0.0; 3]; 3];
        for (row, values) in rotation.iter_mut().zip(by.chunks_exact(3)) {
            row.copy_from_slice(values);
        }
        if incremental {
            let before = self.rotation;
            for (r, row) in rotation.iter_mut().enumerate() {
                let given = [by[3 * r], by[3 * r + 1], by[3 * r + 2]];
                *row = [0, 1, 2].map(|c| (0..3).map(|k| given[k] * before[k][c]).sum());
            }
        }
        self.rotation = rotation;
    }
}

/// The matrices of a coordinate system and the number of the matrix in force.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Transformations {
    matrices: Vec<Matrix>,
    selected: usize,
}

impl Transformations {
    /// `TSELECT`: number 1 to `count`; any other number selects none.
    pub fn select(&mut self, number: usize, count: usize) {
        self.matrices.resize(count, Matrix::default());
        self.selected = if number <= count { number } else { 0 };
    }

    /// The matrix in force.
    #[must_use]
    pub fn selected(&self) -> Option<&Matrix> {
        self.matrices.get(self.selected.checked_sub(1)?)
    }

    /// The matrix in force.
    pub fn selected_mut(&mut self) -> Option<&mut Matrix> {
        self.matrices.get_mut(self.selected.checked_sub(1)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back() {
        let mut matrix = Matrix::default();
        matrix.rotate([0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 2.0], false);
        matrix.displace([10.0, 0.0, 0.0], false);
        assert_eq!(matrix.base([1.0, 2.0, 3.0]), [8.0, 1.0, 6.0]);
        assert_eq!(matrix.programmed([8.0, 1.0, 6.0]), [1.0, 2.0, 3.0]);
        matrix.displace([1.0, 0.0, 0.0], true);
        assert_eq!(matrix.base([0.0; 3]), [10.0, 1.0, 0.0]);
        matrix.rotate([2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0], true);
        assert_eq!(matrix.turned([1.0, 0.0, 0.0]), [0.0, 2.0, 0.0]);
        let mut transformations = Transformations::default();
        transformations.select(2, 1);
        assert!(transformations.selected().is_none());
        transformations.select(1, 1);
        assert_eq!(transformations.selected(), Some(&Matrix::default()));
    }
}
