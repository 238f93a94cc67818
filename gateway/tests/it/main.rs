//! The gateway against a simulated board and its daemon, as processes.

mod epics;
mod hostile;
mod lines;
mod roles;
mod site;
mod strangers;
