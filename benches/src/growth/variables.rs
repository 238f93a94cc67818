//! One client that watches background variables.

use std::time::Duration;

use pmac_dpram::map::VariableName;
use pmac_dpram::segment::{RegionId, Sample};

use super::running::Running;
use crate::rig::Rig;

/// The first of the registers: the board's open memory, so that no two are the same.
const FIRST: usize = 0x0700;

/// Has the board copy `count` registers, and takes each table that comes.
pub fn watch(rig: &Rig, count: usize) -> Running {
    let mut running = Running::new(1);
    running.spawn(|notes| {
        let registers: Vec<VariableName> = (0..count)
            .map(|index| format!("Y:${:04X}", FIRST + index).parse().expect("a register"))
            .collect();
        let _watch = rig.connection().watch_variables(&registers).expect("a watch");
        let reader = rig.subscriber();
        let next = reader.published(RegionId::Variable).expect("variable data") + 1;
        let mut cursor = reader.cursor(RegionId::Variable, next).expect("variable data");
        let (mut sample, mut before) = (Sample::new(), None);
        while notes.goes_on() {
            let last = cursor.position() - 1;
            reader.wait_newer(RegionId::Variable, last, Duration::from_millis(200)).expect("variable data");
            while reader.next(&mut cursor, &mut sample).expect("a sample") {
                let time = sample.stamp().time_ns;
                if let Some(before) = before.replace(time) {
                    notes.took(time - before);
                }
            }
            notes.lost(cursor.lost());
        }
    });
    running
}
