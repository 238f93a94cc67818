//! The house in shape: the invariants of `src/lib.rs` that can be read off the source.
//!
//! Only code counts: comments and everything under `#[cfg(test)]` are taken away first. Each rule lists every breach
//! it finds, and each is tried on text that breaks it.

mod circles;

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use pmac_dpram::map::FAMILIES;

/// The only files that may hold `unsafe`, and map memory.
const ISLANDS: [&str; 3] = ["src/device/mapping.rs", "src/segment/memory.rs", "src/segment/wide_copy.rs"];
/// The same in the libraries for C: the functions that C calls.
const BORDERS: [&str; 6] = [
    "c/pcomm32/src/border.rs",
    "c/src/border/board.rs",
    "c/src/border/commands.rs",
    "c/src/border/mod.rs",
    "c/src/border/updates.rs",
    "c/src/border/values.rs",
];
/// A file one can read in one sitting.
const MOST_LINES: usize = 600;
/// Modules that see less than their layer allows: the simulator is the driver's opponent, the client maps no device.
const SEES_ONLY: [(&str, &[&str]); 2] = [
    ("sim", &["format", "map", "rotary::codes", "device::mapping", "process", "recording"]),
    ("client", &["format", "map", "language", "decode", "rotary", "gather", "protocol", "segment"]),
];
/// Words are mirrored as the board held them: these do not decode.
const DECODES_NOTHING: [&str; 5] = ["device", "function", "mirror", "segment", "daemon"];
/// Modules in which a number that looks like an address is one, and belongs in `map`.
const KNOWS_NO_ADDRESS: [&str; 9] =
    ["decode", "device", "function", "mirror", "segment", "daemon", "client", "sim", "cli"];

/// Offsets that are none in the DPRAM: PMAC's own registers, the segment's layout, I/O ports.
const OTHER_OFFSETS: [&str; 8] = [
    "src/sim/board/firmware.rs",
    "src/sim/board/i_rows.rs",
    "src/sim/board/register_table.rs",
    "src/sim/board/turbo.rs",
    "src/sim/board/turbo_rows.rs",
    "src/segment/layout.rs",
    "src/segment/payload/identity.rs",
    "src/device/board/byte_spec.rs",
];

/// A source file: its path from the package's root, and its code, line by line with the line's number.
#[derive(Clone)]
struct Source {
    path: String,
    text: String,
    code: Vec<(usize, String)>,
}

impl Source {
    fn new(path: &str, text: &str) -> Self {
        Self { path: path.to_owned(), text: text.to_owned(), code: code(text) }
    }

    /// The module directly under the crate: `daemon` for `src/daemon/shared/queue.rs`, `bin` for a program.
    fn module(&self) -> &str {
        let inner = self.path.trim_start_matches("src/");
        inner.split('/').next().unwrap_or(inner).trim_end_matches(".rs")
    }

    /// Every line of code for which `wrong` has something to say.
    fn breaches(&self, wrong: impl Fn(&str) -> Option<String>) -> Vec<String> {
        let said = self.code.iter().filter_map(|(number, line)| Some((number, wrong(line)?)));
        said.map(|(number, what)| format!("{}:{number}: {what}", self.path)).collect()
    }
}

/// The lines without comments and without what only tests see.
fn code(text: &str) -> Vec<(usize, String)> {
    let mut lines = text.lines().enumerate().map(|(index, line)| (index + 1, line));
    let mut kept = Vec::new();
    while let Some((number, line)) = lines.next() {
        let indent = line.len() - line.trim_start().len();
        if line.trim_start().starts_with("#[cfg(") && line.contains("test") {
            // One item: a line that ends it, or everything to the brace that closes it (rustfmt aligns them).
            let end = format!("{:indent$}}}", "");
            let item = lines.by_ref().find(|(_, line)| !line.trim_start().starts_with("#["));
            if item.is_some_and(|(_, line)| !line.ends_with(';') && !line.ends_with('}')) {
                let _ = lines.by_ref().find(|(_, line)| *line == end);
            }
        } else if !line.trim_start().starts_with("//") && !line.trim().is_empty() {
            kept.push((number, line.split(" // ").next().unwrap_or(line).to_owned()));
        }
    }
    kept
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn files_below(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files_below(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

fn sources(below: &str) -> Vec<Source> {
    let mut paths = Vec::new();
    files_below(&root().join(below), &mut paths);
    paths.sort();
    let read = |path: &PathBuf| {
        let name = path.strip_prefix(root()).unwrap().to_str().unwrap().to_owned();
        Source::new(&name, &fs::read_to_string(path).unwrap())
    };
    let sources: Vec<Source> = paths.iter().map(read).collect();
    assert!(!sources.is_empty());
    sources
}

/// The library's and the programs' source, without the files that only tests see.
fn shipped() -> Vec<Source> {
    let mut sources = sources("src");
    sources.retain(|source| !source.path.ends_with("tests.rs") && !source.path.ends_with("/testing.rs"));
    sources
}

fn assert_none(rule: &str, breaches: Vec<String>) {
    assert!(breaches.is_empty(), "{rule}:\n{}", breaches.join("\n"));
}

/// Layer and place within it of each module, as the table in `src/lib.rs` has them.
fn layers(lib: &str) -> BTreeMap<String, (u32, usize)> {
    let rows = lib.lines().filter_map(|line| line.strip_prefix("//! | ")?.split_once(" | "));
    let rows = rows.filter_map(|(layer, modules)| Some((layer.parse::<u32>().ok()?, modules)));
    let names = |modules: &str| {
        let links = modules.split("[`").skip(1).filter_map(|rest| Some(rest.split_once('`')?.0.to_owned()));
        links.map(|name| name.trim_start_matches("mod@").to_owned()).collect::<Vec<_>>()
    };
    rows.flat_map(|(layer, modules)| {
        names(modules).into_iter().enumerate().map(move |(at, name)| (name, (layer, at)))
    })
    .collect()
}

/// The paths that follow `crate::` (in a program, the library's name) on this line.
fn uses(line: &str) -> Vec<String> {
    let path = |rest: &str| {
        let end =
            rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_' && c != ':').unwrap_or(rest.len());
        rest[..end].trim_end_matches(':').to_owned()
    };
    line.split("crate::").skip(1).chain(line.split("pmac_dpram::").skip(1)).map(path).collect()
}

/// Whether `path` is `module` or in it.
fn is_below(path: &str, module: &str) -> bool {
    path.strip_prefix(module).is_some_and(|rest| rest.is_empty() || rest.starts_with("::"))
}

fn layer_breach(layers: &BTreeMap<String, (u32, usize)>, module: &str, line: &str) -> Option<String> {
    let own = layers.get(module);
    uses(line).iter().find_map(|path| {
        let other = path.split("::").next().unwrap_or(path);
        let place = layers.get(other);
        let only = SEES_ONLY.iter().find(|(name, _)| *name == module).map(|(_, only)| *only);
        let seen = |allowed: &&str| is_below(path, allowed);
        let fault = if other == module {
            return None;
        } else if place.is_none() {
            "no module of the table; one `use` a module"
        } else if module != "bin" && own.is_none_or(|own| place >= Some(own)) {
            "not below it"
        } else if only.is_some_and(|only| !only.iter().any(seen)) {
            "more than it may see"
        } else if other == "sim" && module != "bin" {
            "the simulator, which the driver must not know"
        } else if other == "decode" && DECODES_NOTHING.contains(&module) {
            "decoding, which is the client's"
        } else {
            return None;
        };
        Some(format!("{module} uses {path}: {fault}"))
    })
}

/// The rooms of `src/device` in the order of the table in its `mod.rs`, and the room of each name that it gives out itself.
fn device_rooms(text: &str) -> (Vec<String>, BTreeMap<String, String>) {
    let rows = text.lines().filter_map(|line| line.strip_prefix("//! | ")?.split_once(" | "));
    let names = rows.map(|(name, _)| name).filter(|name| name.contains('`'));
    let names = names.map(|name| name.replace(['[', '`', ']'], ""));
    let given = text.lines().filter_map(|line| line.strip_prefix("pub use ")?.split_once("::"));
    let given = given.flat_map(|(room, names)| {
        let names = names.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        names.filter(|name| !name.is_empty()).map(|name| (name.to_owned(), room.to_owned()))
    });
    (names.collect(), given.collect())
}

#[test]
fn a_room_of_the_device_uses_only_rooms_above_it_in_the_table() {
    let (rooms, given) = device_rooms(&fs::read_to_string(root().join("src/device/mod.rs")).unwrap());
    let place = |room: &str| rooms.iter().position(|name| name == room);
    let mut breaches = Vec::new();
    for source in shipped().iter().filter(|source| source.path != "src/device/mod.rs") {
        let Some(inner) = source.path.strip_prefix("src/device/") else { continue };
        let own = inner.split(['/', '.']).next().and_then(place).expect("a row of the table");
        let uses: Vec<_> = source.code.iter().filter(|(_, line)| line.contains("crate::device::")).collect();
        for (number, line) in uses {
            let names = line.split("crate::device::").nth(1).unwrap_or_default();
            let is_list = names.starts_with('{');
            for name in names.trim_matches(['{', '}', ';']).split(", ").take(if is_list { 99 } else { 1 }) {
                let first = name.split([':', ';', '<', '(', ')', '{', '}', ',', ' ']).next().unwrap_or(name);
                let room = given.get(first).map_or(first, String::as_str);
                if place(room).is_none_or(|other| other > own) {
                    breaches.push(format!("{}:{number}: uses {name}", source.path));
                }
            }
        }
    }
    assert_none("the order of rooms in src/device/mod.rs", breaches);
    assert!(place("decorators") < place("board") && given["Counted"] == "decorators");
}

#[test]
fn every_module_stands_in_the_table_of_layers_and_says_so_itself() {
    let lib = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let layers = layers(&lib);
    let declared = lib.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'));
    let mut declared: Vec<&str> = declared.collect();
    declared.sort_unstable();
    assert_eq!(layers.keys().collect::<Vec<_>>(), declared);
    for (module, (layer, _)) in &layers {
        let paths = [format!("src/{module}/mod.rs"), format!("src/{module}.rs")];
        let text = paths.iter().find_map(|path| fs::read_to_string(root().join(path)).ok()).unwrap();
        assert!(text.lines().take(2).any(|line| line.contains(&format!("(layer {layer})"))), "{module}");
    }
}

#[test]
fn a_module_uses_only_what_lies_below_it() {
    let layers = layers(&fs::read_to_string(root().join("src/lib.rs")).unwrap());
    let mut breaches = Vec::new();
    for source in shipped().iter().filter(|source| source.path != "src/lib.rs") {
        breaches.extend(source.breaches(|line| layer_breach(&layers, source.module(), line)));
        // `super` out of the module's own tree would be another way to its neighbours.
        let depth = source.path.matches('/').count() - usize::from(source.path.ends_with("/mod.rs"));
        let too_far = "super::".repeat(depth.max(1));
        let leaves = |line: &str| line.contains(&too_far).then(|| "super leads out of the module".to_owned());
        breaches.extend(source.breaches(leaves));
    }
    assert_none("layers, as in src/lib.rs", breaches);

    for (module, allowed) in SEES_ONLY {
        let own: Vec<Source> = shipped().into_iter().filter(|source| source.module() == module).collect();
        let used = |path: &&&str| {
            own.iter()
                .any(|s| s.code.iter().any(|(_, line)| uses(line).iter().any(|seen| is_below(seen, path))))
        };
        let unused: Vec<_> = allowed.iter().filter(|path| !used(path)).collect();
        assert!(unused.is_empty(), "{module} uses none of {unused:?}: take them off its list");
    }

    for (module, line) in [
        ("segment", "use crate::mirror::ServoMirror;"),
        ("function", "    crate::daemon::main()"),
        ("daemon", "use crate::sim::world::World;"),
        ("sim", "use crate::function::servo;"),
        ("sim", "use crate::device::FileBoard;"),
        ("client", "use crate::device::Bus;"),
        ("mirror", "use crate::decode::value;"),
        ("map", "use crate::{format, segment};"),
    ] {
        assert!(layer_breach(&layers, module, line).is_some(), "{module}: {line}");
    }
    assert!(layer_breach(&layers, "mirror", "use crate::segment::Publisher;").is_none());
    assert!(layer_breach(&layers, "sim", "use crate::device::mapping::Mapping;").is_none());
}

#[test]
fn unsafe_code_lives_on_its_islands() {
    for manifest in ["Cargo.toml", "c/Cargo.toml"] {
        let manifest = fs::read_to_string(root().join(manifest)).unwrap();
        for lint in ["unsafe_code", "unsafe_op_in_unsafe_fn", "undocumented_unsafe_blocks"] {
            assert!(manifest.contains(&format!("{lint} = \"deny\"")), "{lint}");
        }
    }
    let word = |line: &str| {
        let words = line.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        words
            .into_iter()
            .any(|word| word == "unsafe" || word == "unsafe_code")
            .then(|| line.trim().to_owned())
    };
    let islands = || ISLANDS.into_iter().chain(BORDERS);
    let elsewhere = |source: &&Source| !islands().any(|island| island == source.path);
    let sources: Vec<Source> = ["src", "c/src", "c/pcomm32/src"].into_iter().flat_map(sources).collect();
    let breaches = sources.iter().filter(elsewhere).flat_map(|source| source.breaches(word)).collect();
    assert_none("unsafe outside its islands", breaches);
    for island in islands() {
        let source = sources.iter().find(|source| source.path == island).unwrap();
        assert!(!source.breaches(word).is_empty(), "{island} needs no unsafe and is no island");
    }
}

/// A name service may hang for seconds. What looks a name up is called at the start only.
#[test]
fn the_sockets_thread_looks_no_name_up() {
    let look_ups = ["getgrouplist", "User::from_", "Group::from_", "group_id("];
    let word = |line: &str| look_ups.iter().any(|word| line.contains(word)).then(|| line.trim().to_owned());
    let allowed = ["policy.rs", "listener.rs"].map(|file| format!("src/daemon/socket/{file}"));
    let sources = sources("src");
    let others = sources.iter().filter(|source| {
        let rooms = ["src/daemon/socket/", "src/daemon/motion/"];
        rooms.iter().any(|room| source.path.starts_with(room)) && !allowed.contains(&source.path.to_string())
    });
    let breaches = others.flat_map(|source| source.breaches(word)).collect();
    assert_none("names are looked up at the start", breaches);
    let policy = fs::read_to_string(root().join(&allowed[0])).unwrap();
    assert_eq!(policy.matches("Group::from_name").count(), 1, "only by `group_id`");
    assert!(!policy.contains("getgrouplist") && !policy.contains("User::from_"));
}

/// memmap2's other types hand out slices of memory that another agent writes.
fn mapping_breach(path: &str, line: &str) -> Option<String> {
    let mut names = line.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let foreign = line.contains("memmap2") && !ISLANDS.contains(&path);
    let slices = names.any(|name| name.starts_with("Mmap") && !["MmapRaw", "MmapOptions"].contains(&name));
    let calls = [".map(&", ".map(file", ".map_mut(", ".map_exec(", ".map_copy", ".map_anon("];
    let maps = ISLANDS.contains(&path) && calls.iter().any(|call| line.contains(call));
    (foreign || slices || maps).then(|| line.trim().to_owned())
}

#[test]
fn memory_is_mapped_through_mmap_raw_only() {
    let breaches = shipped()
        .iter()
        .flat_map(|source| source.breaches(|line| mapping_breach(&source.path, line)))
        .collect();
    assert_none("memmap2 is used on the islands, as MmapRaw", breaches);
    assert!(mapping_breach("src/device/board/file.rs", "use memmap2::MmapRaw;").is_some());
    assert!(mapping_breach(ISLANDS[0], "use memmap2::{Mmap, MmapRaw};").is_some());
    assert!(mapping_breach(ISLANDS[0], "let map = MmapOptions::new().map_mut(file)?;").is_some());
}

/// Where a family's DPRAM lies in PMAC's address space, and where its fixed words end, as a host offset.
struct Addresses {
    pmac: Range<u32>,
    fixed_end: u32,
}

/// The DPRAM of every family there is, and those that a Turbo board can have besides, on accessory boards: $06C000 to
/// $06FFFF (Turbo User Manual p. 45).
fn addresses() -> Vec<Addresses> {
    let known = FAMILIES.iter().map(|family| Addresses {
        pmac: family.base..family.base + family.length / 4,
        fixed_end: family.user_area.start.bytes(),
    });
    known.chain([Addresses { pmac: 0x06_0000..0x07_0000, fixed_end: 0x1140 }]).collect()
}

/// A DPRAM address in code, of any family: a host offset (even, of three digits or more), or a PMAC address.
fn address_breach(families: &[Addresses], path: &str, line: &str) -> Option<String> {
    let offsets_of_its_own = OTHER_OFFSETS.contains(&path);
    let address = |rest: &str| {
        let end = rest.find(|c: char| !c.is_ascii_hexdigit() && c != '_').unwrap_or(rest.len());
        let digits = rest[..end].replace('_', "");
        let Ok(value) = u32::from_str_radix(&digits, 16) else { return false };
        let is_offset = |family: &Addresses| value < family.fixed_end && value.is_multiple_of(2);
        // A longer number is a mask; one of six digits with zeros in front is a word of PMAC's.
        let is_pmac_address = |family: &Addresses| family.pmac.contains(&value) && digits.len() <= 6;
        families.iter().any(is_pmac_address)
            || !offsets_of_its_own && (3..=5).contains(&digits.len()) && families.iter().any(is_offset)
    };
    line.split("0x").skip(1).any(address).then(|| line.trim().to_owned())
}

#[test]
fn only_the_map_knows_addresses() {
    let families = addresses();
    let shipped = shipped();
    let guarded = shipped.iter().filter(|source| KNOWS_NO_ADDRESS.contains(&source.module()));
    let breaches =
        guarded.flat_map(|source| source.breaches(|line| address_breach(&families, &source.path, line)));
    assert_none("DPRAM addresses belong in src/map", breaches.collect());
    for path in OTHER_OFFSETS {
        let mut exempt = shipped.iter().filter(|source| source.path == path);
        let used =
            exempt.any(|source| !source.breaches(|line| address_breach(&families, "", line)).is_empty());
        assert!(used, "{path} has no offset of its own: take it off the list");
    }
    let (function, offsets) = ("src/function/servo.rs", "src/sim/board/i_rows.rs");
    for (path, line) in [
        (function, "bus.read16(HostOffset::new(0x0026))?;"),
        (function, "let first = 0x228;"),
        (offsets, "let buffer = 0xD200;"),
        (function, "let ready = HostOffset::new(0x0E9C);"),
        (function, "let motors = 0x06_001D;"),
        (offsets, "let table = 0x60450;"),
        (function, "let second = 0x06C000;"),
    ] {
        assert!(address_breach(&families, path, line).is_some(), "{line}");
    }
    for (path, line) in [
        (offsets, "let counter = 0x0000;"),
        (function, "let mask = 0x00FF_FFFF;"),
        (function, "let mask = 0x0006_0000;"),
        (function, "let marker = 0x00_0800;"),
        (function, "let numbers = 0x00FF;"),
        (function, "let cancel = 0x18;"),
    ] {
        assert!(address_breach(&families, path, line).is_none(), "{line}");
    }
}

#[test]
fn only_the_device_layer_knows_paths_of_devices() {
    let named = |line: &str| {
        let found = ["\"/dev", "\"/sys", "\"/proc"].iter().any(|path| line.contains(path));
        let may = ["const DIRECTORY: &str = \"/dev/shm\"", "const DESCRIPTORS: &str = \"/proc/self/fd\""];
        (found && !may.iter().any(|line_of| line.contains(line_of))).then(|| line.trim().to_owned())
    };
    let shipped = shipped();
    let elsewhere = shipped.iter().filter(|source| source.module() != "device");
    assert_none("paths in /dev and /sys", elsewhere.flat_map(|source| source.breaches(named)).collect());
    assert!(named("let shm = Path::new(\"/dev/shm\");").is_some());
}

#[test]
fn nothing_shipped_panics_on_purpose() {
    let panics = ["unwrap()", ".expect(\"", "panic!(", "unreachable!(", "todo!(", "unimplemented!(", "dbg!("];
    let wrong = |line: &str| panics.iter().any(|call| line.contains(call)).then(|| line.trim().to_owned());
    let others = ["gateway/src", "web/src", "c/src", "c/pcomm32/src"].into_iter().flat_map(sources);
    let all = shipped().into_iter().chain(others);
    assert_none("panics", all.flat_map(|source| source.breaches(wrong)).collect());
    assert!(wrong("let word = words.first().unwrap();").is_some());
}

#[test]
fn a_file_can_be_read_in_one_sitting_and_says_what_it_is() {
    let mut breaches = Vec::new();
    for source in [
        "src",
        "tests",
        "gateway/src",
        "gateway/tests",
        "web/src",
        "c/src",
        "c/tests",
        "c/pcomm32/src",
        "c/pcomm32/tests",
    ]
    .into_iter()
    .flat_map(sources)
    {
        let lines = source.text.lines().count();
        if lines > MOST_LINES {
            breaches.push(format!("{} has {lines} lines", source.path));
        }
        if !source.text.starts_with("//! ") {
            breaches.push(format!("{} has no header", source.path));
        }
    }
    assert_none("files", breaches);
}

#[test]
fn tests_and_comments_are_taken_away_before_anything_is_judged() {
    let text = "//! Header\nuse a;\n#[cfg(test)]\nmod far;\nfn f() {} // why\n#[cfg(test)]\n#[path = \"x\"]\nmod tests {\n    g();\n}\nfn h() {}\n";
    let kept = code(text);
    let kept: Vec<(usize, &str)> = kept.iter().map(|(number, line)| (*number, line.as_str())).collect();
    assert_eq!(kept, [(2, "use a;"), (5, "fn f() {}"), (11, "fn h() {}")]);
}
