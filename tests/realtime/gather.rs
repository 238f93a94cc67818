//! Gathering in real time.

use std::time::{Duration, Instant};

use pmac_dpram::function::gather::GatherPoll;
use pmac_dpram::function::servo_timer::ServoTimer;
use pmac_dpram::gather::GatherMode;

use crate::support::PATIENCE;
use crate::support::gather_rig::{GatherRig, take};

#[test]
fn in_real_time_what_was_missed_is_exact() {
    const SAMPLES: u64 = 4000;
    let mut rig = GatherRig::start("1.16D", &[]);
    let mut timer = ServoTimer::new(15);
    let plan = rig.plan(GatherMode::Wrap, Some(600));
    let mut reader = rig.begin(&plan, &mut timer);
    let (mut begin, mut taken) = (None, 0);
    let start = Instant::now();
    while reader.written() < SAMPLES {
        assert!(start.elapsed() < PATIENCE, "{}", reader.written());
        let look = take(&mut rig, &mut reader, &mut timer, &plan, |number, values| {
            let begin = *begin.get_or_insert(values[0] - number as f64);
            assert_eq!(values[0], begin + number as f64);
            taken += 1;
            if number % 997 == 0 {
                // The board goes round several times meanwhile.
                std::thread::sleep(Duration::from_millis(130));
            }
        });
        assert!(matches!(look, GatherPoll::Idle | GatherPoll::Disturbed), "{look:?}");
    }
    // What a disturbed look left behind is neither taken nor lost yet.
    assert_eq!(taken + reader.lost() + reader.waiting(), reader.written());
    assert!(taken > 0);
    rig.finish();
}
