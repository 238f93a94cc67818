//! No circles of imports between files, read off the source.
//!
//! A file sees another one through `use`, and through paths with `crate::`, `super::` or the name of a module of its own.
//! What a module re-exports is looked up where it stands. A `pub use` alone makes no edge. Methods need no import, so
//! a type's inherent methods have to stand in its own file or in that of a child module; such a child and its parent are
//! one thing in two files, and may use each other.

use std::collections::{BTreeMap, BTreeSet};

use super::{Source, shipped};

/// A module's path from the crate's root: `["sim", "board"]`.
type Path = Vec<String>;

/// One name that a `use` brings in: the name, and where it comes from.
struct Import {
    name: String,
    from: Path,
    public: bool,
}

struct File {
    path: String,
    module: Path,
    imports: Vec<Import>,
    /// Other paths in the code, from the crate's root on.
    paths: Vec<Path>,
    /// Types that have inherent methods here.
    inherent: Vec<String>,
}

fn module(path: &str) -> Path {
    let inner = path.trim_start_matches("src/").trim_end_matches(".rs");
    let inner = inner.strip_suffix("mod").map_or(inner, |rest| rest.trim_end_matches('/'));
    match inner {
        "lib" => Vec::new(),
        inner => inner.split('/').map(str::to_owned).collect(),
    }
}

fn is_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// The single paths of a use tree: `a::{b, c::d as e}` is `a::b` and `a::c::d` (as e).
fn leaves(tree: &str, before: &str, found: &mut Vec<(String, String)>) {
    let tree = tree.trim();
    if let Some(open) = tree.find('{') {
        let before = format!("{before}{}", &tree[..open]);
        let inner = &tree[open + 1..tree.rfind('}').unwrap_or(tree.len())];
        let (mut depth, mut start) = (0, 0);
        for (at, c) in inner.char_indices().chain([(inner.len(), ',')]) {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    if !inner[start..at].trim().is_empty() {
                        leaves(&inner[start..at], &before, found);
                    }
                    start = at + 1;
                }
                _ => {}
            }
        }
        return;
    }
    let (path, name) = tree.split_once(" as ").unwrap_or((tree, tree.rsplit("::").next().unwrap_or(tree)));
    let path = format!("{before}{}", path.trim());
    let path = path.trim_end_matches("::self").to_owned();
    let name = if name.trim() == "self" { path.rsplit("::").next().unwrap_or("") } else { name.trim() };
    found.push((name.to_owned(), path));
}

impl File {
    fn new(source: &Source) -> Self {
        let module = module(&source.path);
        let code: String = source.code.iter().map(|(_, line)| format!("{line}\n")).collect();
        let children: BTreeSet<&str> = code
            .lines()
            .filter_map(|line| line.trim().strip_suffix(';')?.rsplit_once("mod ").map(|(_, name)| name))
            .collect();
        let mut file = Self {
            path: source.path.clone(),
            module,
            imports: Vec::new(),
            paths: Vec::new(),
            inherent: Vec::new(),
        };
        let mut rest = String::new();
        let mut lines = code.lines();
        while let Some(line) = lines.next() {
            let start = line.trim_start();
            let statement = start.strip_prefix("use ").or_else(|| Some(start.split_once(" use ")?.1));
            let public = start.starts_with("pub");
            match statement.filter(|_| start.starts_with("use ") || public) {
                Some(first) => {
                    let mut tree = first.to_owned();
                    while !tree.contains(';') {
                        tree.push_str(lines.next().unwrap_or(";").trim());
                    }
                    let mut found = Vec::new();
                    leaves(tree.trim_end().trim_end_matches(';'), "", &mut found);
                    for (name, path) in found {
                        if let Some(from) = file.absolute(&path, &children) {
                            file.imports.push(Import { name, from, public });
                        }
                    }
                }
                None => {
                    rest.push_str(line);
                    rest.push('\n');
                }
            }
        }
        file.inherent = rest.lines().filter_map(inherent).collect();
        let mut at = 0;
        while let Some(next) = rest[at..].find("::") {
            let start = rest[..at + next].rfind(|c| !is_name(c)).map_or(0, |start| start + 1);
            let end = rest[start..].find(|c| !is_name(c) && c != ':').map_or(rest.len(), |end| start + end);
            if let Some(path) = file.absolute(rest[start..end].trim_end_matches(':'), &children) {
                file.paths.push(path);
            }
            at = end.max(at + next + 2);
        }
        file
    }

    /// `path` from the crate's root on; `None` for another crate's, or for what an import has brought in.
    fn absolute(&self, path: &str, children: &BTreeSet<&str>) -> Option<Path> {
        let mut segments: Vec<&str> = path.split("::").collect();
        let mut from: Path = match segments[0] {
            "crate" | "pmac_dpram" => {
                segments.remove(0);
                Vec::new()
            }
            "self" => {
                segments.remove(0);
                self.module.clone()
            }
            "super" => self.module.clone(),
            child if children.contains(child) => self.module.clone(),
            _ => return None,
        };
        while segments.first() == Some(&"super") {
            segments.remove(0);
            from.pop();
        }
        from.extend(segments.into_iter().map(str::to_owned));
        Some(from)
    }
}

/// The type of an `impl Type {`.
fn inherent(line: &str) -> Option<String> {
    let rest = line.strip_prefix("impl")?;
    let rest = match rest.strip_prefix('<') {
        Some(generic) => generic.split_once("> ")?.1,
        None => rest.strip_prefix(' ')?,
    };
    let name: String = rest.chars().take_while(|c| is_name(*c)).collect();
    (!rest.contains(" for ") && !name.is_empty()).then_some(name)
}

struct House {
    files: Vec<File>,
    by_module: BTreeMap<Path, usize>,
}

impl House {
    fn new(sources: &[Source]) -> Self {
        let files: Vec<File> = sources.iter().map(File::new).collect();
        let by_module = files.iter().enumerate().map(|(index, file)| (file.module.clone(), index)).collect();
        Self { files, by_module }
    }

    /// The file that defines what `path` names; re-exports are followed.
    fn file(&self, path: &[String], depth: usize) -> Option<usize> {
        let known = (0..=path.len()).rev().find(|end| self.by_module.contains_key(&path[..*end]))?;
        let index = self.by_module[&path[..known]];
        let Some(item) = path.get(known).filter(|_| depth < 8) else { return Some(index) };
        match self.files[index].imports.iter().find(|import| import.name == *item) {
            Some(import) => {
                let mut target = import.from.clone();
                target.extend_from_slice(&path[known + 1..]);
                self.file(&target, depth + 1)
            }
            None => Some(index),
        }
    }

    fn is_child(&self, child: usize, parent: usize) -> bool {
        let (child, parent) = (&self.files[child].module, &self.files[parent].module);
        child.len() > parent.len() && child.starts_with(parent)
    }

    /// The files whose types have inherent methods in the file `index`.
    fn extended(&self, index: usize) -> impl Iterator<Item = usize> {
        let file = &self.files[index];
        file.inherent.iter().filter_map(move |name| {
            let import = file.imports.iter().find(|import| import.name == *name)?;
            self.file(&import.from, 0).filter(|&owner| owner != index)
        })
    }

    /// Whom each file uses; a child that holds methods of its parent's type uses only others.
    fn edges(&self) -> Vec<BTreeSet<usize>> {
        let of = |(index, file): (usize, &File)| {
            let parents: Vec<usize> =
                self.extended(index).filter(|&owner| self.is_child(index, owner)).collect();
            let imports = file.imports.iter().filter(|import| !import.public).map(|import| &import.from);
            let found = imports.chain(&file.paths).filter_map(|path| self.file(path, 0));
            found.filter(|other| *other != index && !parents.contains(other)).collect()
        };
        self.files.iter().enumerate().map(of).collect()
    }

    /// The files that can be reached from themselves.
    fn in_circles(&self) -> BTreeSet<&str> {
        let edges = self.edges();
        let reaches_itself = |start: usize| {
            let (mut seen, mut next) = (BTreeSet::new(), vec![start]);
            while let Some(at) = next.pop() {
                next.extend(edges[at].iter().copied().filter(|other| seen.insert(*other)));
            }
            seen.contains(&start)
        };
        (0..self.files.len())
            .filter(|&index| reaches_itself(index))
            .map(|index| self.files[index].path.as_str())
            .collect()
    }

    /// The files that hold inherent methods of a type that is neither theirs nor a parent's.
    fn strays(&self) -> BTreeSet<&str> {
        let stray = |index: &usize| self.extended(*index).any(|owner| !self.is_child(*index, owner));
        (0..self.files.len()).filter(stray).map(|index| self.files[index].path.as_str()).collect()
    }
}

#[test]
fn files_do_not_import_each_other_in_circles() {
    let house = House::new(&shipped());
    assert_eq!(house.in_circles(), BTreeSet::new(), "in a circle of imports");
}

#[test]
fn a_types_methods_stand_in_its_file_or_in_its_children() {
    let house = House::new(&shipped());
    assert_eq!(house.strays(), BTreeSet::new(), "hold methods of a type of another file");
}

fn house(files: &[(&str, &str)]) -> House {
    House::new(&files.iter().map(|(path, text)| Source::new(path, text)).collect::<Vec<_>>())
}

#[test]
fn circles_are_seen_through_every_kind_of_path() {
    let circle = |files: &[(&str, &str)]| house(files).in_circles().len();
    let a = |text| ("src/a.rs", text);
    let b = ("src/b.rs", "use crate::a::A;");
    assert_eq!(circle(&[a("use crate::c;"), b]), 0);
    assert_eq!(circle(&[a("use crate::{b::B, c};"), b]), 2);
    assert_eq!(circle(&[a("fn f() { super::b::g() }"), b]), 2);
    assert_eq!(circle(&[a("pub use crate::b::B;"), b]), 0, "a re-export alone");
    assert_eq!(circle(&[a("use crate::b::{\n    C,\n    B as D,\n};"), b]), 2);
    let re_exported = [("src/m/mod.rs", "pub use b::B;\nmod b;"), ("src/m/b.rs", "use crate::a::A;")];
    assert_eq!(circle(&[a("use crate::m::B;"), re_exported[0], re_exported[1]]), 2);
    assert_eq!(circle(&[a("use crate::m::C;"), re_exported[0], re_exported[1]]), 0);
    let parent = ("src/m/mod.rs", "mod b;\npub struct C;\nfn f() { b::run() }");
    assert_eq!(circle(&[parent, ("src/m/b.rs", "use super::C;")]), 2);
    assert_eq!(circle(&[parent, ("src/m/b.rs", "use super::C;\nimpl C {\n}")]), 0, "one thing in two files");
}

#[test]
fn strays_are_seen_through_imports() {
    let stray = |text| {
        house(&[("src/a.rs", text), ("src/b.rs", ""), ("src/a/c.rs", "use super::A;\nimpl A {}")])
            .strays()
            .len()
    };
    assert_eq!(stray("use crate::b::B;\nimpl B {\n}"), 1);
    assert_eq!(stray("use crate::b::B;\nimpl<'a> B<'a> {\n}"), 1);
    assert_eq!(stray("use crate::b::B;\nimpl Clone for B {\n}\nimpl A {\n}"), 0);
}
