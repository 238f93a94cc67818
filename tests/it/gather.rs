//! Gathering from a simulated board in its own process, as planned, read, decoded and written by the library.

use std::io::Cursor;

use pmac_dpram::function::gather::GatherPoll;
use pmac_dpram::function::servo_timer::ServoTimer;
use pmac_dpram::gather::{GatherMode, SampleClock, fields};
use pmac_dpram::table::{CsvWriter, NpyWriter};

use crate::support::gather_rig::{GatherRig, scales, take};

#[test]
fn a_minute_of_every_servo_cycle_loses_nothing() {
    for (firmware, seconds) in [("1.16D", 60.0), ("1.16B", 1.0)] {
        let mut rig = GatherRig::start(firmware, &["--virtual"]);
        let mut timer = ServoTimer::new(15);
        let plan = rig.plan(GatherMode::Wrap, None);
        let mut reader = rig.begin(&plan, &mut timer);
        rig.send("#1J+");
        let clock = SampleClock { period: plan.period, servo_period_ns: scales().servo_period_ns() };
        let mut csv = CsvWriter::new(Vec::new(), &fields(&plan.columns, clock)).unwrap();
        let mut npy = NpyWriter::new(Cursor::new(Vec::new()), &fields(&plan.columns, clock)).unwrap();
        let (mut next, mut begin, mut last) = (0, None, 0.0);
        while clock.at(next) < seconds {
            rig.pass(400);
            let look = take(&mut rig, &mut reader, &mut timer, &plan, |number, values| {
                assert_eq!(number, next, "in order, without a gap");
                next += 1;
                // The board's own counter says that no servo cycle is missing between two samples.
                let begin = *begin.get_or_insert(values[0]);
                assert_eq!(values[0], begin + number as f64);
                assert!(values[1] >= last - 1.0 && values[1] < last + 20.0, "{} after {last}", values[1]);
                assert!((values[1] - values[2]).abs() < 200.0, "it follows");
                last = values[1];
                let row = [&[number as f64, clock.at(number)], values].concat();
                csv.row(&row).unwrap();
                npy.row(&row).unwrap();
            });
            assert_eq!(look, GatherPoll::Idle);
        }
        assert_eq!((reader.lost(), reader.written()), (0, next));
        // 32 counts a millisecond, less the time to get there.
        assert!(last > (seconds - 0.5) * 32_000.0 * 0.99, "{last}");

        rig.send("ENDGATHER");
        reader.stopped();
        let look = take(&mut rig, &mut reader, &mut timer, &plan, |_, _| {});
        assert_eq!(look, GatherPoll::Ended);
        rig.pass(5000);
        assert_eq!(take(&mut rig, &mut reader, &mut timer, &plan, |_, _| {}), GatherPoll::Ended);

        let csv = String::from_utf8(csv.finish().unwrap()).unwrap();
        let head = "sample,time_s,servo_timer [servo cycles],1.actual_position [count],\
                    1.commanded_position [count],1.actual_velocity [count per servo cycle]";
        assert_eq!(csv.lines().next(), Some(head));
        assert_eq!(csv.lines().count() as u64, next + 1);
        let npy = npy.finish().unwrap().into_inner();
        assert!(npy.len() as u64 - next * 6 * 8 < 1024);
        rig.finish();
    }
}

#[test]
fn laps_of_the_board_are_counted_exactly() {
    let mut rig = GatherRig::start("1.16D", &["--virtual"]);
    let mut timer = ServoTimer::new(15);
    // 40 samples of 6 longs.
    let plan = rig.plan(GatherMode::Wrap, Some(240));
    let mut reader = rig.begin(&plan, &mut timer);
    let (mut begin, mut taken) = (None, 0);
    for pause in [1, 39, 40, 41, 80, 1000, 7, 12_345] {
        rig.pass(pause);
        let look = take(&mut rig, &mut reader, &mut timer, &plan, |number, values| {
            let begin = *begin.get_or_insert(values[0] - number as f64);
            assert_eq!(values[0], begin + number as f64, "numbered as the board counts");
            taken += 1;
        });
        assert_eq!(look, GatherPoll::Idle);
        assert_eq!(taken + reader.lost(), reader.written());
    }
    assert!(reader.lost() > 13_000);
    rig.finish();
}

#[test]
fn a_buffer_that_stops_at_its_end_is_read_whole() {
    let mut rig = GatherRig::start("1.16D", &["--virtual"]);
    let mut timer = ServoTimer::new(15);
    let plan = rig.plan(GatherMode::Stop, Some(1000));
    assert_eq!(plan.buffer_longs, 1002);
    let mut reader = rig.begin(&plan, &mut timer);
    rig.pass(1000);
    let mut numbers = Vec::new();
    let look = take(&mut rig, &mut reader, &mut timer, &plan, |number, _| numbers.push(number));
    assert_eq!((look, numbers.len(), reader.lost()), (GatherPoll::Ended, 167, 0));
    rig.send("DEFINE GATHER 1002");
    let look = take(&mut rig, &mut reader, &mut timer, &plan, |_, _| {});
    assert!(matches!(look, GatherPoll::Redefined { size: 1002, index: 0 }));
    rig.finish();
}
