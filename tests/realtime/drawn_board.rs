//! A simulated board drawn from a seed: its family and its DPRAM, how it reads the manual, how slow it is, what it powers up
//! with.

use std::fmt;

use pmac_dpram::map::{FAMILIES, Family, Generation, READINGS};

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

/// Readings of what boards of one generation alone have; all others are of both.
const READINGS_OF_ONE: &[(Generation, &[&str])] = &[
];

/// Whether boards of `family` differ by the reading called `name`.
fn has_reading(family: &Family, name: &str) -> bool {
    let mut others = READINGS_OF_ONE.iter().filter(|(generation, _)| *generation != family.generation);
    !others.any(|(_, names)| names.contains(&name))
}

/// A board, and what its daemon has to be told of it.
pub struct DrawnBoard {
    seed: u64,
    family: &'static Family,
    /// Options of the simulator.
    options: Vec<String>,
    /// The daemon's configuration: the readings that it cannot find out by itself.
    settings: String,
    /// What the board does at power-up.
    startup: &'static str,
}

impl DrawnBoard {
    /// A board of the family asked for, or of any. Of every reading that its family has, a value.
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
        let mut settings = "[readings]\n".to_owned();
        for reading in READINGS.iter().filter(|reading| has_reading(family, reading.name)) {
            let (name, value) = (reading.name, random.one_of(reading.values));
            options.extend(["--reading".to_owned(), format!("{name}={value}")]);
            if !reading.found_out {
                settings += &format!("{name} = {value:?}\n");
            }
        }
        let startup = match family.generation {
            Generation::Pmac => include_str!("../../src/sim/dpram-startup.pmc"),
            Generation::Turbo => include_str!("../../src/sim/dpram-startup-turbo.pmc"),
        };
        Self { seed, family, options, settings, startup }
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
        let startup = site.file("startup.pmc", self.startup);
        site.start_simulator(&self.simulator(&[&["--startup", &startup], more].concat()));
    }

    /// Starts the daemon that is told of it what it cannot find out, and `more` of the configuration.
    pub fn start_daemon(&self, site: &mut Site, more: &str) {
        // Its tables stand behind what belongs to none.
        let text = format!("family = {:?}\n{more}{}", self.family.name, self.settings);
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
    for reading in READINGS {
        for value in reading.values {
            let option = format!("--reading {}={value}", reading.name);
            assert!(is_drawn(&option), "{option} is never drawn");
        }
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

#[test]
fn c6_a_board_is_told_no_reading_of_another_family() {
    for (generation, names) in READINGS_OF_ONE {
        for family in FAMILIES.iter().filter(|family| family.generation != *generation) {
            let boards = (0..32).map(|seed| DrawnBoard::new(seed, Some(family)).to_string());
            for (board, name) in boards.flat_map(|board| names.iter().map(move |name| (board.clone(), name)))
            {
                assert!(!board.contains(&format!(" {name}=")), "{board}");
                assert!(READINGS.iter().any(|reading| reading.name == *name), "{name}");
            }
        }
    }
}
