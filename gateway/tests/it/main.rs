//! The gateway against a simulated board and its daemon, as processes.

mod lines;
mod site;
