//! The output of commands: the terminal, tables, output files and signals.

mod confirm;
pub mod input;
mod interrupt;
mod keys;
pub mod late;
mod note;
pub mod output;
mod progress;
pub mod sink;
pub mod table;
pub mod table_file;
mod time;

pub use confirm::{board_of, confirm, sending};
pub use interrupt::Interrupt;
pub use keys::Keys;
pub use late::warn_if_late;
pub use note::note;
pub use output::Output;
pub use progress::Progress;
pub use sink::is_stdout;
pub use table::Table;
pub use table_file::TableFile;
pub use time::{rfc3339, rfc3339_now};
