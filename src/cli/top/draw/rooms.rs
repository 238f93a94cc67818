//! Shares the rows of the screen among its parts.

/// Rows of each part; 0 for a part that the screen leaves out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rooms {
    pub health: u16,
    pub motors: u16,
    pub trace: u16,
    pub systems: u16,
    pub watches: u16,
}

/// The least rows of a part with a heading.
const LEAST: u16 = 4;
/// Fewer rows have no room for everything.
const FEW: u16 = 12;
/// More rows would make a trace no clearer.
const TRACE: u16 = 14;

impl Rooms {
    /// Shares `rows` out among parts that would like `like` rows. The motors come first, but take less than half of
    /// many rows; then the watches, the health, the coordinate systems and the trace.
    pub fn share(rows: u16, like: Self) -> Self {
        let mut left = rows;
        let mut take = |wanted: u16, least: u16| {
            let taken = if wanted.min(left) < least { 0 } else { wanted.min(left) };
            left -= taken;
            taken
        };
        let first = if rows < FEW { rows.saturating_sub(2).max(1) } else { rows / 2 - 1 };
        let mut shared = Self {
            motors: take(like.motors.min(first), 1),
            watches: take(like.watches.min(1), 1),
            ..Self::default()
        };
        shared.health = take(like.health, 1);
        shared.watches += take(like.watches.saturating_sub(shared.watches).min(rows / 6), 0);
        shared.systems = take(like.systems.min(LEAST), 2);
        shared.trace = take(like.trace.min(LEAST), LEAST);
        shared.systems += take(like.systems.saturating_sub(shared.systems), 0);
        shared.motors += take(like.motors.saturating_sub(shared.motors), 0);
        shared.trace += take(if shared.trace > 0 { TRACE - shared.trace } else { 0 }, 0);
        shared
    }

    /// The rows of a trace that are never too many.
    pub const fn trace_likes() -> u16 {
        TRACE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIKE: Rooms = Rooms { health: 3, motors: 9, trace: TRACE, systems: 9, watches: 1 };

    fn sum(rooms: Rooms) -> u16 {
        rooms.health + rooms.motors + rooms.trace + rooms.systems + rooms.watches
    }

    #[test]
    fn the_motors_are_there_however_small_the_screen_is() {
        for rows in 0..200 {
            for motors in [1, 9, 33] {
                let rooms = Rooms::share(rows, Rooms { motors, ..LIKE });
                assert!(sum(rooms) <= rows, "{rows}: {rooms:?}");
                assert!(rows == 0 || rooms.motors > 0, "{rows}: {rooms:?}");
                assert!(rooms.motors <= motors && rooms.systems <= 9 && rooms.trace <= TRACE, "{rooms:?}");
            }
        }
    }

    #[test]
    fn a_usual_screen_has_all_parts() {
        // 80x24 without the title and the last line.
        assert_eq!(Rooms::share(22, LIKE), Rooms { health: 3, motors: 9, trace: 4, systems: 5, watches: 1 });
        let rooms = Rooms::share(22, Rooms { motors: 33, systems: 17, ..LIKE });
        assert_eq!(rooms, Rooms { health: 3, motors: 10, trace: 4, systems: 4, watches: 1 });
        assert_eq!(Rooms::share(38, LIKE), Rooms { health: 3, motors: 9, trace: 14, systems: 9, watches: 1 });
        // 40x10.
        assert_eq!(Rooms::share(8, LIKE), Rooms { health: 1, motors: 6, trace: 0, systems: 0, watches: 1 });
    }
}
