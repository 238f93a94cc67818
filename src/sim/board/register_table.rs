//! PMAC's own registers, as a table a family. [`crate::map::Family`] has the registers in the DPRAM.
//!
//! The registers of motors repeat every `motor_source_stride` addresses of the family, the background registers of
//! motors and coordinate systems every `system_source_stride` (DPRAM manual pp. 14-21, Software Reference p. 399,
//! suggested M-variables).

use std::ops::Range;

use crate::map::{Family, PmacAddress, Space};

/// A register that each motor or coordinate system has.
#[derive(Debug, Clone, Copy)]
pub struct Each {
    /// The register of number 1.
    first: PmacAddress,
    /// Addresses from one number's to the next one's.
    stride: u32,
}

impl Each {
    /// The register whose number 1 is at `first`, and each further one `stride` addresses on.
    #[must_use]
    pub const fn new(stride: u32, first: PmacAddress) -> Self {
        Self { first, stride }
    }

    /// The register of the 0-based motor or coordinate system `index`.
    #[must_use]
    pub const fn of(self, index: usize) -> PmacAddress {
        PmacAddress::new(self.first.space, self.first.number + self.stride * index as u32)
    }

    /// The 0-based motor or coordinate system, of `count`, whose register is at `address`.
    #[must_use]
    pub const fn index_of(self, address: u32, count: usize) -> Option<usize> {
        let Some(behind) = address.checked_sub(self.first.number) else { return None };
        let index = (behind / self.stride) as usize;
        if behind % self.stride == 0 && index < count { Some(index) } else { None }
    }

    /// The register `words` after the register of `index`.
    #[must_use]
    pub const fn behind(self, index: usize, words: usize) -> PmacAddress {
        let PmacAddress { space, number } = self.of(index);
        PmacAddress::new(space, number + words as u32)
    }
}

/// The registers of a family.
#[derive(Debug)]
pub struct RegisterTable {
    /// The servo counter.
    pub servo_counter: PmacAddress,
    /// The countdown timers; empty where I-variables of the coordinate systems are the timers.
    pub timers: &'static [PmacAddress],
    /// First word of `???`.
    pub global_status: PmacAddress,
    /// Second word of `???`.
    pub global_buffers: PmacAddress,
    /// The machine inputs, bit n-1 for input n.
    pub machine_inputs: PmacAddress,
    /// Where the function blocks of compiled PLCs begin.
    pub function_blocks: PmacAddress,
    /// The encoder conversion table, 32 words.
    pub conversion_table: PmacAddress,
    /// The bus set-up registers, ten words; `None` where I90 to I99 hold them.
    pub bus_setup: Option<PmacAddress>,
    /// The copies of the bus set-up registers in force.
    pub bus_active: PmacAddress,
    /// The register in which the board notes the first address behind its DPRAM, if any.
    pub dpram_end: Option<PmacAddress>,
    /// The gate arrays: outputs, encoders and flags. The simulated board does not have them.
    pub hardware: Range<u32>,
    /// The first address behind the registers that a reset clears; variables and buffers lie above.
    pub end: u32,

    /// Time left in the move, 1/2 ms.
    pub time_left: Each,
    /// Desired velocity, 3/(Ix08*32) counts/ms.
    pub desired_velocity: Each,
    /// Commanded position.
    pub commanded: Each,
    /// The Ix03 address, the servo report's "handwheel pointer".
    pub feedback_address: Each,
    /// The Ix05 address.
    pub master_address: Each,
    /// Actual position.
    pub actual: Each,
    /// Following error, in families that have a register for it.
    pub following_error: Option<Each>,
    /// Actual velocity, 1/(Ix09*32) counts per servo cycle.
    pub velocity: Each,
    /// Previous DAC, 1/256 DAC bit.
    pub dac: Each,
    /// First word of `?`.
    pub servo_status: Each,
    /// Compensation.
    pub compensation: Each,

    /// Commanded time base (`%`), units of I10.
    pub time_base_commanded: Each,
    /// Present time base, units of I10 (suggested M198).
    pub time_base_present: Each,
    /// Target position.
    pub target: Each,
    /// Position bias.
    pub bias: Each,
    /// Second word of `?`.
    pub background_status: Each,
    /// Encoder count captured by the last homing (suggested M173).
    pub home_capture: Each,
    /// Second word of `??`, PSTATUS.
    pub program_status: Each,
    /// First word of `??`.
    pub coordinate_status: Each,
    /// Third word of `??`, in families that have it.
    pub coordinate_status_3: Option<Each>,
    /// The motors of the coordinate system, in families that have a register for them.
    pub coordinate_motors: Option<Each>,
    /// Axis target positions A B C U V W X Y Z, neither segmented nor compensated.
    pub axis_targets: Each,
    /// Axis target positions of segmented moves.
    pub segmented_axis_targets: Each,
    /// Averaged velocity.
    pub average_velocity: Each,
    /// The velocity that `V` reports: one of the two.
    pub reported_velocity: Each,
    /// Variable jog position or distance, counts (suggested M172).
    pub jog_variable: Each,
    /// Program lines remaining.
    pub lines_remaining: Each,
}

/// The registers of PMAC and PMAC2.
#[must_use]
pub const fn pmac(family: &Family) -> RegisterTable {
    let (motor, system) = (family.motor_source_stride, family.system_source_stride);
    RegisterTable {
        servo_counter: x(0x0000),
        timers: const { &[x(0x0700), y(0x0700), x(0x0701), y(0x0701)] },
        global_status: x(0x0003),
        global_buffers: y(0x0003),
        machine_inputs: y(0xFFC2),
        function_blocks: y(0x9FFF),
        conversion_table: y(0x0720),
        bus_setup: Some(x(0x0783)),
        bus_active: x(0xE006),
        dpram_end: None,
        hardware: 0xC000..0xC040,
        end: 0x1000,

        time_left: Each::new(motor, x(0x0020)),
        desired_velocity: Each::new(motor, x(0x0026)),
        commanded: Each::new(motor, d(0x0028)),
        feedback_address: Each::new(motor, x(0x0029)),
        master_address: Each::new(motor, x(0x002A)),
        actual: Each::new(motor, d(0x002B)),
        following_error: None,
        velocity: Each::new(motor, x(0x0033)),
        dac: Each::new(motor, x(0x003A)),
        servo_status: Each::new(motor, x(0x003D)),
        compensation: Each::new(motor, d(0x0046)),

        time_base_commanded: Each::new(system, x(0x0806)),
        time_base_present: Each::new(system, x(0x0808)),
        target: Each::new(system, d(0x080B)),
        bias: Each::new(system, d(0x0813)),
        background_status: Each::new(system, y(0x0814)),
        home_capture: Each::new(system, y(0x0815)),
        program_status: Each::new(system, y(0x0817)),
        coordinate_status: Each::new(system, x(0x0818)),
        coordinate_status_3: None,
        coordinate_motors: Some(Each::new(system, y(0x0818))),
        axis_targets: Each::new(system, l(0x0819)),
        segmented_axis_targets: Each::new(system, l(0x0876)),
        average_velocity: Each::new(system, y(0x082A)),
        reported_velocity: Each::new(motor, x(0x0033)),
        jog_variable: Each::new(system, l(0x082B)),
        lines_remaining: Each::new(system, y(0x08AE)),
    }
}

const fn x(number: u32) -> PmacAddress {
    PmacAddress::new(Space::X, number)
}

const fn y(number: u32) -> PmacAddress {
    PmacAddress::new(Space::Y, number)
}

const fn d(number: u32) -> PmacAddress {
    PmacAddress::new(Space::D, number)
}

const fn l(number: u32) -> PmacAddress {
    PmacAddress::new(Space::L, number)
}
