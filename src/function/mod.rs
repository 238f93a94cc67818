//! The host's half of each automatic function, one per file (layer 3).
//!
//! A function never waits. Each poll looks at the bus, does the work that is possible now, and returns. The caller
//! decides how often to poll and when to give up. A function writes only the bits that the host owns. A function knows
//! no address: its caller passes a descriptor of [`crate::map::functions`], so the function works on the board of any
//! family.
//!
//! # A new function
//! A function has two files of its own, besides tests:
//! * here: what host and PMAC write in which order;
//! * in `daemon/bus/work/`, a `BoardFunction`: when the function is due, what it does then, how the daemon acquires
//!   and leaves it. A function that fills a region of the segment is a mirror with a few lines in
//!   `daemon/bus/work/mirrored.rs`.
//!
//! A function also has lines in these files; the compiler asks for them once the name and the descriptor exist:
//! * `map/functions.rs` and `map/family/mod.rs`: its descriptor, and each family's;
//! * `protocol/function.rs`: its name in the configuration;
//! * `daemon/bus/function_table.rs`: its row in the table, and the dispatch of its commands;
//! * `daemon/bus/board_loop.rs`: whether its polls show that the board runs;
//! * `setup/enable.rs`: what switches it on;
//! * `daemon/shared/job.rs`, `daemon/socket/jobs.rs` and `daemon/socket/methods.rs`: its commands, if it takes any.
//!
//! # What each function costs
//! Bus accesses of 16 bits (the mailboxes' of 8, and 32 of data where the board takes them), counted by tests for
//! several n. *Necessary* are the data and the words by which host and PMAC hand them over. The further accesses make
//! sure that the data are whole, that no other host meddled, or that a write has arrived. An idle poll finds nothing
//! to do.
//!
//! | what | necessary | counted | for example |
//! |---|---|---|---|
//! | servo update, optimistic, n motors | 30n + 6 | 30n + 6 | n = 8: 246 |
//! | servo update, handshake | 30n + 8 | 30n + 9 | n = 8: 249 |
//! | servo without spare words, n motors | 26n + 6 | 26n + 6 | n = 8: 214 |
//! | servo, handshake, without spare words | 26n + 8 | 26n + 9 | n = 8: 217 |
//! | servo of w words a motor, n motors | wn + 6 | wn + 6 | position and status, w = 6, n = 2: 18 |
//! | servo by 32 bits, n motors | 15n + 4 | 15n + 4 | n = 8: 124 |
//! | servo by 32 bits, handshake | 15n + 6 | 15n + 7 | n = 8: 127 |
//! | servo by 32 bits without spare words | 13n + 4 | 13n + 4 | n = 8: 108 |
//! | servo idle poll, either way | 1 | 1 | 1 |
//! | servo of a Turbo board, n motors of the mask | 24n + 5 | 24n + 5 | n = 8: 197 |
//! | servo of a Turbo board, handshake | 24n + 8 | 24n + 9 | n = 8: 201 |
//! | servo of a Turbo board by 32 bits, n motors | 12n + 5 | 12n + 5 | n = 8: 101 |
//! | servo of a Turbo board by 32 bits, handshake | 12n + 8 | 12n + 9 | n = 8: 105 |
//! | the mask of a Turbo board: written once, then read every 256 updates | 2 | 2 | 2 |
//! | background report, n numbers | 62n + 9 | 62n + 11 | n = 8: 507 |
//! | background of w words a number | wn + 9 | wn + 11 | two status words, w = 4, n = 8: 43 |
//! | background by 32 bits | 31n + 6 | 31n + 8 | n = 8: 256 |
//! | background idle poll | 1 | 1 | 1 |
//! | variable read set-up, e entries | 2e + 4 | 2e + 4 | e = 128: 260 |
//! | variable read report, w words of values | w + 3 | w + 5 | 128 of X: 261 |
//! | variable read by 32 bits, a report | w/2 + 3 | w/2 + 5 | 128 of X: 133 |
//! | variable read idle poll | 1 | 1 | 1 |
//! | variable read multi-user, a idle poll at e entries of which k are new, w words | e + w + k + 1 | e + w + k + 2 | e = k = 5, L: 32 |
//! | variable read multi-user idle poll at e entries, none new | e | e + 1 | e = 5: 6 |
//! | variable write, r records in c cycles | 6r + 3c | 6r + 3c + 1 | r = 32, c = 1: 196 |
//! | variable write idle poll | 1 | 1 | 1 |
//! | panel request, n numbers, until seen taken | n + 2 | n + 3 | n = 8: 11 |
//! | panel idle poll | 1 | 1 | 1 |
//! | feed override set; the first one 1 more | 2 | 2 | 2 |
//! | feed override ended | 1 | 1 | 1 |
//! | open words, n whole | n | n | n = 8: 8 |
//! | the site's own words under g guards, w words | w + 2g | w + 2g | w = 8, g = 1: 10 |
//! | the site's own words without a guard, y of X and Y, v values of w words | y + vw | y + 2vw | y = 2, v = 4, w = 2: 18 |
//! | open words, n of which some bits | 2n | 2n | n = 8: 16 |
//! | gather, s samples of l longs, s l up to 64 | 2sl + 2 | 2sl + 3 | s = 8, l = 8: 131 |
//! | gather by 32 bits | sl + 2 | sl + 3 | s = 8, l = 8: 67 |
//! | gather idle poll | 1 | 2 | 2 |
//! | gather round and round (I45=3), s samples | 2sl + 5 | 2sl + 6 | s = 8, l = 8: 134 |
//! | gather idle poll, round and round | 3 | 4 | 4 |
//! | rotary set-up; 1 more if the status is not 0, 2 more on Turbo boards | 9 | 10 | 10 |
//! | rotary line of c commands | 4c + 6 | 4c + 7 | c = 3: 19 |
//! | rotary idle poll, no room; until PMAC was once full 1 more | 1 | 2 | 2 |
//! | rotary state | 2 | 3 | 3 |
//! | ASCII line of n, reply of m characters | n/2 + m/2 + 10 | n/2 + m/2 + 10 | n = m = 20: 30 |
//! | ASCII line by 32 bits | n/2 + m/4 + 10 | n/2 + m/4 + 10 | n = m = 20: 25 |
//! | mailbox line of n, reply of m characters | n + m + 4 + ceil((m+1)/16) | n + m + 5 + 2 ceil((m+1)/16) | n = m = 20: 49 |
//! | released at start and end: servo, background, variable read, variable write, panel | 7 | 7 | 1 + 1 + 2 + 1 + 2: 7 |
//!
//! With `,access=32` behind the board, the host reads the data that PMAC has handed over by 32 bits, two words of one
//! location by one access. It never reads the words of the handover by 32 bits. A function that the configuration
//! switches off makes no access at all.
//!
//! Halves and quarters of n and m are rounded down. A poll of the variable reader looks at as many entries of a table
//! as [`variable_read::POLL_WORDS`] words allow; the next poll goes on with the next ones. In single-user mode the
//! cost of a report does not depend on the number of polls. The daemon itself writes open words. The host reads the
//! site's own words up to four times if the board writes them meanwhile.
//!
//! # What a command line costs
//! Bus accesses for a line of n characters that the board answers with one line of m characters, counted by a test.
//! Accesses of the DPRAM have 16 bits, those of the mailboxes 8:
//!
//! | | DPRAM ([`ascii`], n up to 159) | VME mailboxes ([`mailbox`]) |
//! |---|---|---|
//! | the line | n/2 + 4 | n + 1 |
//! | to see it taken | 1 | 0; an interrupt a group of 15 |
//! | the reply line | m/2 + 3 | m + 1, and 2 a group of 16; an interrupt a group |
//! | the acknowledgement | 2 | 3, an interrupt |
//! | all | n/2 + m/2 + 10 | n + m + 5 + 2 ceil((m+1)/16) |
//! | `P1` and 2 digits | 12 | 11 |
//! | 20 and 20 characters | 30 | 49 |
//! | 80 and 80 characters | 90 | 177 |
//! | each idle poll in vain | 2 until it is taken, then 1 | 0 |

pub mod ascii;
pub mod background;
#[cfg(test)]
mod cost_tests;
pub mod gather;
#[cfg(test)]
mod gather_tests;
pub mod host_port;
pub mod line_port;
pub mod mailbox;
pub mod panel;
#[cfg(test)]
mod part_cost_tests;
#[cfg(test)]
mod port_cost_tests;
pub mod rotary;
#[cfg(test)]
mod rotary_tests;
pub mod servo;
pub mod servo_timer;
#[cfg(test)]
mod testing;
pub mod user_words;
pub mod variable_read;
pub mod variable_write;
