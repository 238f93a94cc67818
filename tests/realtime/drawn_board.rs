//! A simulated board drawn from a seed: its family and its DPRAM, how slow it is, what it powers up with, and what no text
//! decides.

use std::fmt;

use pmac_dpram::map::{FAMILIES, Family};

use crate::support::Site;

/// Evenly spread numbers from a seed (splitmix64).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ mixed >> 31
    }

    pub fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }

    pub fn one_of<T: Copy>(&mut self, among: &[T]) -> T {
        among[self.below(among.len() as u64) as usize]
    }
}

/// How many times as long as usual SAVE, $$$, DEFINE, DELETE and LIST may take.
const FACTORS: [&str; 5] = ["0", "0.5", "1", "2", "4"];

/// A board, and what its daemon has to be told of it.
pub struct DrawnBoard {
    seed: u64,
    family: &'static Family,
    /// Options of the simulator.
    options: Vec<String>,
    /// Where its CODE2 stands, which its daemon is told.
    rotary_code2: &'static str,
}

impl DrawnBoard {
    /// A board of the family asked for, or of any.
    pub fn new(seed: u64, family: Option<&'static Family>) -> Self {
        // Far from the seeds of the campaign's runs.
        let mut random = Random(!seed);
        let drawn = random.one_of(FAMILIES);
        let family = family.unwrap_or(drawn);
        let mut options = ["--family", family.name, "--dpram", family.dpram()].map(str::to_owned).to_vec();
        options.extend(["--slow".to_owned(), random.one_of(&FACTORS).to_owned(), "--garbage".to_owned()]);
        options.push(random.below(1 << 32).to_string());
        if random.below(2) == 0 {
            options.push("--saved-enables".to_owned());
        }
        let rotary_code2 = random.one_of(&["bit12", "bit16"]);
        options.extend(["--rotary-code2", rotary_code2].map(str::to_owned));
        Self { seed, family, options, rotary_code2 }
    }

    pub fn family(&self) -> &'static Family {
        self.family
    }

    /// The options of its simulator, and `more`.
    pub fn simulator<'a>(&'a self, more: &[&'a str]) -> Vec<&'a str> {
        self.options.iter().map(String::as_str).chain(more.iter().copied()).collect()
    }

    /// Powers it up at `site` with all functions enabled, and `more` options.
    pub fn power_up(&self, site: &mut Site, more: &[&str]) {
        site.start_simulator(&self.simulator(&[&["--dpram-startup"], more].concat()));
    }

    /// Starts the daemon that is told of it what no text decides, and `more` of the configuration.
    pub fn start_daemon(&self, site: &mut Site, more: &str) {
        // Its tables stand behind what belongs to none.
        let Self { family, rotary_code2, .. } = self;
        let text = format!("family = {:?}\n{more}[readings]\nrotary_code2 = {rotary_code2:?}\n", family.name);
        let config = site.file("config.toml", &text);
        site.start_daemon(&["--config", &config]);
    }

    /// The board of `family` that the variable `name` of the environment says, without it the one of seed `seed`.
    pub fn asked_by(name: &str, seed: u64, family: &'static Family) -> Self {
        let asked = std::env::var(name).ok().map(|seed| seed.parse().expect("the seed of a board"));
        Self::new(asked.unwrap_or(seed), Some(family))
    }

    /// The board and its daemon.
    pub fn site(&self, more: &[&str]) -> Site {
        println!("{self}");
        let mut site = Site::new();
        self.power_up(&mut site, more);
        self.start_daemon(&mut site, "");
        site
    }
}

impl fmt::Display for DrawnBoard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "board {}: pmac-sim {}", self.seed, self.options.join(" "))
    }
}

#[test]
fn boards_differ_by_their_seed_and_by_nothing_else() {
    let text = |seed| DrawnBoard::new(seed, None).to_string();
    assert_eq!(text(7), text(7));
    let drawn: Vec<String> = (0..200).map(text).collect();
    let is_drawn = |option: &str| drawn.iter().any(|board| board.contains(option));
    for value in ["bit12", "bit16"] {
        assert!(is_drawn(&format!("--rotary-code2 {value}")), "{value}");
    }
    for factor in FACTORS {
        assert!(is_drawn(&format!("--slow {factor} ")), "{factor}");
    }
    for family in FAMILIES {
        // The DPRAM that it comes with: a board that is a file has no setting for another.
        let option = format!("--family {} --dpram {} ", family.name, family.dpram());
        assert!(is_drawn(&option), "{option}");
    }
}
