//! A daemon that pauses: what the board made meanwhile is not told as newer or older than it is.

use std::time::Duration;

use nix::sys::signal::Signal;
use pmac_dpram::segment::{RegionId, Sample, monotonic_ns};

use crate::support::{Site, is_live, wait_until};

#[test]
fn background_data_are_no_older_than_they_say() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    wait_until("background data", || is_live(&subscriber, RegionId::Background));
    let mut sample = Sample::new();
    for pause in [100, 1500, 2000] {
        site.signal_daemon(Signal::SIGSTOP);
        std::thread::sleep(Duration::from_millis(pause));
        let timer = site.status()["servo_timer"].as_u64().unwrap() as u16;
        let since = monotonic_ns();
        site.signal_daemon(Signal::SIGCONT);
        let mut seen = 0;
        let mut last = 0;
        wait_until("reports made since", || {
            let sequence = subscriber.latest(RegionId::Background, &mut sample).unwrap().unwrap();
            if sequence != last && sample.stamp().time_ns >= since {
                // Its timer says when it was made.
                let later = (sample.stamp().servo_timer as u16).wrapping_sub(timer).cast_signed();
                assert!(later >= 0, "made {} servo cycles before the time it bears", -later);
                (seen, last) = (seen + 1, sequence);
            }
            seen == 5
        });
    }
    site.assert_no_violations();
}
