//! The board's map (layer 1): addresses, register tables per board family, status bits.
//!
//! Only this module knows an address. [`Family`] is everything that differs between board families: limits, the numbers
//! of I-variables, the register table, and a descriptor of each automatic function ([`functions`]). [`Layout`] is the
//! register table of a board with a given firmware, [`TypedAddress`] an address as a person types it, [`PmacRegister`]
//! a register of PMAC's own memory, [`VariableName`] a register or block that PMAC copies and writes in its background.

pub mod address;
pub mod buffer_layout;
pub mod errors;
pub mod family;
pub mod field;
pub mod firmware;
pub mod function;
pub mod functions;
pub mod i_variables;
pub mod layout;
pub mod m_definition;
pub mod mailbox;
pub mod masks;
pub mod number;
pub mod readings;
pub mod region;
pub mod register;
pub mod selection;
pub mod status;
pub mod table;
pub mod typed;
pub mod user_word;
pub mod variable_name;
pub mod word_use;

/// The axes in the order in which the fixed buffers hold them.
pub const AXES: [&str; 9] = ["A", "B", "C", "U", "V", "W", "X", "Y", "Z"];

pub use address::{HostOffset, PmacAddress, Space};
pub use buffer_layout::{BufferLayout, BufferLayoutError, BufferSettings, NotUserArea, Owner};
pub use family::pmac;
pub use family::pmac_table::PANEL_REQUEST_BITS;
pub use family::{
    CPU_OPTIONS, DEFAULT_FAMILY, DPRAM_SIZES, FAMILIES, Family, Generation, LACKS_DPRAM, OtherFamily, PMAC,
    PMAC2, TURBO, TURBO_32K, TURBO2, TURBO2_8K, UnknownFamily, lacks_dpram,
};
pub use field::{BitField, Field, FieldError};
pub use firmware::{BadFirmware, Firmware};
pub use function::{Function, UnknownFunction};
pub use functions::{
    AsciiPort, BackgroundBlock, Blocks, BusyRule, Controller, Flag, GatherPlace, IVariables, PanelBlock,
    ReportStart, RotaryHeaders, Run, ServoBlock, StartRule, Timer, VariableKind, VariableRead, VariableWrite,
    WholeBoard,
};
pub use i_variables::{IVariable, i_variable};
pub use layout::{Entry, Layout, MapRecord, records};
pub use masks::{Motors, Systems};
pub use readings::Readings;
pub use region::Region;
pub use register::{BadRegister, PmacRegister};
pub use selection::{BlockField, Selection, block_fields};
pub use status::{MotionMode, StatusTable, StatusTables, TargetSource};
pub use table::{Bits, Block, Confidence, Format, NumberKind, Register, Source, SourceAt, Width, Writer};
pub use typed::{AddressError, TypedAddress};
pub use variable_name::{BadVariable, VariableName};
