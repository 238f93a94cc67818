//! The segment under measurement: the servo data of eight motors, as the daemon publishes them.

use std::path::Path;

use pmac_dpram::segment::{CreateOptions, Publisher, RegionId, RegionSpec, SegmentName, Stamp, Subscriber};

/// Bytes of the servo buffer.
pub const BYTES: usize = 516;
/// The same as words of 16 bit.
pub const WORDS: usize = BYTES / 2;
/// Slots of the servo ring, as the daemon has them.
pub const SLOTS: u32 = 4096;
/// What is published.
pub const SERVO: RegionId = RegionId::Servo;

fn name(name: &str) -> SegmentName {
    SegmentName::new(name).expect("a good name")
}

/// A new segment in `directory`.
pub fn publisher(directory: &Path, called: &str) -> Publisher {
    let region = |id, slots, payload_bytes| RegionSpec {
        id,
        slots,
        payload_bytes,
        first_host_offset: 0x24,
        blocks: pmac_dpram::segment::BlockPlace::NONE,
        period_hint_ns: 442_708,
        stale_after_ns: 0,
    };
    let regions = vec![
        region(RegionId::Board, 4, 256),
        region(RegionId::Panel, 4, 36),
        region(RegionId::Background, 16, 1028),
        region(RegionId::Servo, SLOTS, BYTES as u32),
    ];
    let mut options = CreateOptions::new(name(called), regions);
    directory.clone_into(&mut options.directory);
    options.heartbeat_limit_ns = 3_600_000_000_000;
    Publisher::create(&options).expect("a segment")
}

/// A reader of it.
pub fn subscriber(directory: &Path, called: &str) -> Subscriber {
    Subscriber::attach_in(directory, &name(called)).expect("the segment")
}

/// A stamp without a system call.
pub fn stamp(time_ns: u64) -> Stamp {
    Stamp { time_ns, servo_timer: time_ns, valid: true }
}

/// Update `number`: that number, as far as 16 bit hold it, in every word.
#[inline]
pub fn fill(words: &mut [u16; WORDS], number: u64) {
    words.fill(number as u16);
}
