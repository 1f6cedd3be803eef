//! Sweeps: variants of a scene, each in a folder of its own that is complete or absent.

use std::collections::BTreeMap;
use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use toml::{Spanned, Table, Value};

use crate::Failure;
use crate::arguments::Arguments;
use crate::command::{say, warn};
use crate::output::Outputs;
use crate::overrides::overriding;
use crate::play::play;
use crate::receipt::{self, Figures, Inputs, Receipt, hash, input_files, lanes};
use crate::scene::file::{File, Source, Vary};
use crate::scene::{Scene, replacing};
use crate::variant_folder::{VariantFolder, failed};

/// Most variants of a sweep.
const MOST: u64 = 1_000_000;

/// A scene and the keys that are varied in it.
pub(crate) struct Sweep {
    path: PathBuf,
    source: Source,
    /// The scene without `vary`.
    table: Table,
    /// The path of each varied key, and its values.
    keys: Vec<(String, Vec<Value>)>,
}

impl Sweep {
    /// Reads the scene given on the command line.
    pub(crate) fn read(arguments: &Arguments) -> Result<Sweep, Failure> {
        let path = arguments.scene.clone().unwrap_or_default();
        let (source, file) = Source::read(&path)?;
        let mut table: Table = toml::from_str(source.text()).map_err(|error| Failure::input(error.message()))?;
        table.remove("vary");
        let mut keys: Vec<(String, Vec<Value>)> = Vec::new();
        let mut count: u64 = 1;
        for given in &file.vary {
            let Vary { key, values, first, count: numbers } = given.get_ref();
            // Before the values are made: a count may be larger than memory.
            count = count.saturating_mul(given.get_ref().number());
            if count > MOST {
                return Err(source.wrong_in(given, format_args!("more than {MOST} variants; give fewer values")));
            }
            let all: Vec<Value> = match (values.is_empty(), first, numbers) {
                (false, None, None) => values.iter().map(|value| value.get_ref().clone()).collect(),
                (true, first, Some(count)) => {
                    let first = first.unwrap_or(1);
                    (0..i64::from(count.0)).map(|k| Value::Integer(first.saturating_add(k))).collect()
                }
                _ => return Err(source.wrong_in(given, format_args!("{key}: give values, or a count and where it begins"))),
            };
            if keys.iter().any(|(earlier, _)| earlier == key) {
                return Err(source.wrong_in(given, format_args!("{key} is varied twice; name it once")));
            }
            if let Some(option) = overriding(arguments, &table, key, &all) {
                let message = format_args!("{key} is varied, but {option} overrides its values; leave out one of the two");
                return Err(source.wrong_in(given, message));
            }
            // A key that no scene has is wrong in every variant; a value may be wrong in one, which keeps no other from running.
            check(&table, key, &all[0], |why| why.contains("unknown field")).map_err(|why| source.wrong_in(given, why))?;
            if arguments.list {
                // The numbers that a key may have are without gaps, so the ends of a count stand for those between.
                let ends = [&all[0], &all[all.len() - 1]].map(|end| (given.span().start, end));
                let written = values.iter().map(|value| (value.span().start, value.get_ref()));
                for (at, value) in written.chain(ends) {
                    check(&table, key, value, |_| true).map_err(|why| source.wrong(at, why))?;
                }
            }
            keys.push((key.clone(), all));
        }
        Ok(Sweep { path, source, table, keys })
    }

    /// Number of variants: the combinations of all values.
    pub(crate) fn count(&self) -> u32 {
        if self.keys.is_empty() { 0 } else { self.keys.iter().map(|(_, values)| values.len() as u32).product() }
    }

    /// Runs variants one after another. One that fails does not affect the others.
    pub(crate) fn run(
        &self,
        arguments: &Arguments,
        variants: RangeInclusive<u32>,
        interrupted: &AtomicBool,
    ) -> Result<(), Failure> {
        let count = self.count();
        if count == 0 {
            return Err(self.source.wrong(0, "there is no [[vary]], so there are no variants"));
        }
        if *variants.end() > count {
            let message = format_args!("--variant {}: the scene has {count} variants, numbered from 1", variants.end());
            return Err(Failure::input(message));
        }
        // The code of the first failure, and the last one, which the caller prints.
        let mut failed: Option<(u8, Failure)> = None;
        for number in variants {
            let done = self.variant(arguments, number, interrupted);
            match done {
                Ok(line) if !arguments.quiet => say(&line),
                Ok(_) => {}
                Err(failure) if failure.code == Failure::INTERRUPTED => {
                    failed.into_iter().for_each(|(_, failure)| warn("error", &failure.message));
                    let message = format_args!("interrupted in variant {number}, of which nothing is kept");
                    return Err(Failure::new(Failure::INTERRUPTED, message));
                }
                Err(failure) => {
                    let failure = failure.of(&format!("variant {number}"));
                    let code = failed.as_ref().map_or(failure.code, |(code, _)| *code);
                    if let Some((_, earlier)) = failed.replace((code, failure)) {
                        warn("error", &earlier.message);
                    }
                }
            }
        }
        failed.map_or(Ok(()), |(code, failure)| Err(Failure { code, ..failure }))
    }

    /// Runs a variant unless it is complete; returns a message about it.
    fn variant(&self, arguments: &Arguments, number: u32, interrupted: &AtomicBool) -> Result<String, Failure> {
        let values = self.values(number);
        let mut table = self.table.clone();
        for (key, value) in &values {
            set(&mut table, key, value).map_err(|why| self.source.wrong(0, why))?;
        }
        let text = toml::to_string(&table).map_err(|error| self.source.wrong(0, error))?;
        let said = values.iter().map(|(key, value)| format!("{key} = {value}")).collect::<Vec<_>>().join(", ");
        let scene_hash = hash(text.as_bytes());
        let (source, file) = Source::parse(&self.path, text, Some(said))?;
        check_files(arguments, &source, &file)?;
        let mut scene = Scene::of(arguments, Some((&source, &file)))?;

        // The scene file itself is covered by its hash, which does not depend on other variants.
        let read: Vec<PathBuf> = scene.outputs.read.iter().filter(|&path| *path != self.path).cloned().collect();
        let inputs = Inputs {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            variant: number,
            values: values
                .iter()
                .map(|(key, value)| Ok((key.clone(), json(value)?)))
                .collect::<Result<BTreeMap<_, _>, Failure>>()?,
            scene: scene_hash,
            arguments: hash(overrides(arguments).as_bytes()),
            files: input_files(&read)?,
        };
        let out = scene.outputs.folder.clone();
        fs::create_dir_all(&out).map_err(|error| failed(&out, error))?;
        let folder = VariantFolder::of(&out, number);
        let is_done = || Receipt::in_folder(&folder.complete).is_some_and(|receipt| receipt.inputs == inputs);
        let finished = |before: &str| format!("variant {number} is in {}{before}", folder.complete.display());
        if is_done() && folder.is_settled() {
            return Ok(finished(""));
        }
        let lock = folder.lock();
        // Another process may have made it meanwhile, or hold the lock for as long as it takes to find it complete.
        if is_done() {
            return Ok(finished(""));
        }
        let _lock = lock?;
        let before = folder.replaced()?;
        folder.begin()?;
        scene.outputs.move_into(&folder.partial);
        let played = play(&scene, true, || Ok(()), interrupted);
        let report = played.inspect_err(|_| drop(folder.abandon()))?;
        let receipt = Receipt {
            inputs,
            backend: report.backend.to_owned(),
            adapter: report.adapter.clone(),
            lanes: lanes(),
            figures: Figures::of(&report),
        };
        receipt.write(&folder.partial)?;
        folder.finish()?;
        Ok(finished(before))
    }

    /// The values of the keys in a variant, counted from 1; the last key changes fastest.
    fn values(&self, number: u32) -> Vec<(String, Value)> {
        let mut rest = number as usize - 1;
        let mut values: Vec<(String, Value)> = Vec::new();
        for (key, all) in self.keys.iter().rev() {
            values.push((key.clone(), all[rest % all.len()].clone()));
            rest /= all.len();
        }
        values.reverse();
        values
    }
}

impl Vary {
    /// The number of values.
    fn number(&self) -> u64 {
        self.count.as_ref().map_or(self.values.len() as u64, |count| count.0.into())
    }
}

/// Tells that a scene has variants, none of which is run.
pub(crate) fn note(file: &File) {
    let count = file.vary.iter().fold(1, |count: u64, vary| count.saturating_mul(vary.get_ref().number()));
    if !file.vary.is_empty() && (1..=MOST).contains(&count) {
        let advice = format!("the scene is run without the values of [[vary]]; --variant 1-{count} runs it with them");
        warn("note", &advice);
    }
}

impl Outputs {
    /// Moves all outputs into one folder, which is to have a receipt, too.
    fn move_into(&mut self, folder: &Path) {
        folder.clone_into(&mut self.folder);
        self.read.push(folder.join(receipt::NAME));
        for path in [&mut self.pc2, &mut self.preview, &mut self.animation, &mut self.report].into_iter().flatten() {
            *path = path.file_name().map_or_else(|| path.clone(), |name| folder.join(name));
        }
    }
}

/// Checks that the scene has a key, and can have this value there; what is wrong with the value counts only if `matters`.
fn check(table: &Table, key: &str, value: &Value, matters: impl Fn(&str) -> bool) -> Result<(), String> {
    let mut varied = table.clone();
    set(&mut varied, key, value)?;
    let varied = toml::to_string(&varied).map_err(|error| error.to_string())?;
    match toml::from_str::<File>(&varied) {
        Err(error) if matters(error.message()) => Err(format!("{key} = {value}: {}", error.message())),
        _ => Ok(()),
    }
}

/// Sets the value at a path: tables by key, lists by name or by number from 1.
fn set(table: &mut Table, path: &str, value: &Value) -> Result<(), String> {
    let (parents, last) = path.rsplit_once('.').map_or((None, path), |(parents, last)| (Some(parents), last));
    let mut at = table;
    let mut words = parents.into_iter().flat_map(|parents| parents.split('.'));
    while let Some(word) = words.next() {
        at = match at.get_mut(word) {
            Some(Value::Table(inner)) => inner,
            Some(Value::Array(list)) => {
                let Some(item) = words.next() else {
                    return Err(format!("{path} is all of an item of a list; name a key of it, as in {path}.name"));
                };
                if list.iter().filter(|one| is_named(one, item)).count() > 1 {
                    return Err(format!("{path}: more than one `{word}` is called `{item}`; give its number from 1"));
                }
                let found = place(list, item).and_then(|place| list[place].as_table_mut());
                found.ok_or_else(|| format!("{path}: `{word}` has no `{item}`; give a name or a number from 1"))?
            }
            _ => {
                return Err(format!("{path}: the scene has no `{word}` with keys; write it there as a table, or vary all of it"));
            }
        };
    }
    at.insert(last.to_owned(), value.clone());
    Ok(())
}

/// The place of the item of a list with this name or number from 1.
pub(crate) fn place(list: &[Value], item: &str) -> Option<usize> {
    let by_number = || item.parse::<usize>().ok()?.checked_sub(1).filter(|&place| place < list.len());
    list.iter().position(|one| is_named(one, item)).or_else(by_number)
}

fn is_named(one: &Value, name: &str) -> bool {
    one.get("name").and_then(Value::as_str) == Some(name)
}

/// The command line, except which variants are run and the output folder.
fn overrides(arguments: &Arguments) -> String {
    let arguments = Arguments { variant: None, list: false, quiet: false, scene: None, out: None, ..arguments.clone() };
    format!("{arguments:?}")
}

fn json(value: &Value) -> Result<serde_json::Value, Failure> {
    serde_json::to_value(value).map_err(|error| Failure::input(format_args!("a value of [[vary]]: {error}")))
}

/// Checks that the meshes can be read again: each variant reads them, and its receipt has their hashes.
fn check_files(arguments: &Arguments, source: &Source, file: &File) -> Result<(), Failure> {
    let of_cloths = file.cloth.iter().filter_map(|cloth| cloth.get_ref().mesh.as_ref());
    let colliders = file.collider.iter().map(Spanned::get_ref);
    let read = colliders.filter(|collider| replacing(arguments, collider.shape).is_none());
    let of_colliders = read.flat_map(|collider| collider.mesh.iter().chain(&collider.start));
    let in_scene = of_cloths.chain(of_colliders).map(|mesh| source.beside(mesh.get_ref()));
    let given = arguments.mesh.iter().chain(&arguments.body).cloned();
    let is_pipe = |path: &PathBuf| fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir());
    let message =
        |path: PathBuf| format!("{}: it is a pipe, and each variant reads its meshes again; give a file", path.display());
    given.chain(in_scene).find(is_pipe).map_or(Ok(()), |path| Err(Failure::input(message(path))))
}
