//! A simulated board drawn from a seed: how it reads the manual, how slow it is, what it powers up with.

use std::fmt;

use pmac_dpram::map::READINGS;

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
    /// Options of the simulator.
    options: Vec<String>,
    /// The daemon's configuration: the readings that it cannot find out by itself.
    settings: String,
}

impl DrawnBoard {
    /// Every reading there is, a value each.
    pub fn new(seed: u64) -> Self {
        // Far from the seeds of the campaign's runs.
        let mut random = Random(!seed);
        let mut options =
            vec!["--slow".to_owned(), random.one_of(&FACTORS).to_owned(), "--garbage".to_owned()];
        options.push(random.below(1 << 32).to_string());
        if random.below(2) == 0 {
            options.push("--saved-enables".to_owned());
        }
        let mut settings = "[readings]\n".to_owned();
        for reading in READINGS {
            let (name, value) = (reading.name, random.one_of(reading.values));
            options.extend(["--reading".to_owned(), format!("{name}={value}")]);
            if !reading.found_out {
                settings += &format!("{name} = {value:?}\n");
            }
        }
        Self { seed, options, settings }
    }

    /// The options of its simulator, and `more`.
    pub fn simulator<'a>(&'a self, more: &[&'a str]) -> Vec<&'a str> {
        self.options.iter().map(String::as_str).chain(more.iter().copied()).collect()
    }

    /// Powers it up at `site` with all functions enabled, and `more` options.
    pub fn power_up(&self, site: &mut Site, more: &[&str]) {
        site.start_simulator(&self.simulator(&[&["--dpram-startup"], more].concat()));
    }

    /// Starts the daemon that is told of it what it cannot find out, and `more` of the configuration.
    pub fn start_daemon(&self, site: &mut Site, more: &str) {
        let config = site.file("config.toml", &format!("{more}{}", self.settings));
        site.start_daemon(&["--config", &config]);
    }

    /// The board that the variable `name` of the environment says, without it the one of seed `seed`.
    pub fn asked_by(name: &str, seed: u64) -> Self {
        Self::new(std::env::var(name).ok().map_or(seed, |seed| seed.parse().expect("the seed of a board")))
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
    let text = |seed| DrawnBoard::new(seed).to_string();
    assert_eq!(text(7), text(7));
    let drawn: Vec<String> = (0..64).map(text).collect();
    for reading in READINGS {
        for value in reading.values {
            let option = format!("--reading {}={value}", reading.name);
            assert!(drawn.iter().any(|board| board.contains(&option)), "{option} is never drawn");
        }
    }
    for factor in FACTORS {
        assert!(drawn.iter().any(|board| board.contains(&format!("--slow {factor} "))), "{factor}");
    }
}
