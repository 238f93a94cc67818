//! The gateway against a simulated board and its daemon, as processes.

mod epics;
mod fuzz_corpus;
mod hostile;
mod lines;
mod roles;
mod scan;
mod site;
mod strangers;
mod texts;
mod window;
