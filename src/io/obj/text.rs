//! The statements of an OBJ, and what they may be.

use std::borrow::Cow;

/// A `v` or `f` statement and the line on which it begins.
pub(super) struct Statement<'a> {
    pub line: usize,
    pub text: Cow<'a, str>,
}

impl Statement<'_> {
    pub(super) fn is_vertex(&self) -> bool {
        self.text.starts_with('v')
    }
}

/// The text's `v` and `f` statements, without comments and with continued lines joined.
///
/// Only these statements are continued: a path or a comment may end in `\` and must not swallow the vertex on the next
/// line.
pub(super) fn statements(text: &str) -> impl Iterator<Item = Statement<'_>> {
    // `tobj` would read a byte order mark as part of the first word, and lose that vertex.
    let mut lines = text.strip_prefix('\u{feff}').unwrap_or(text).lines().zip(1..);
    std::iter::from_fn(move || {
        let is_statement = |&(line, _): &(&str, usize)| {
            let line = bare(line);
            let uncontinued = line.strip_suffix('\\').unwrap_or(line);
            matches!(uncontinued.split_whitespace().next(), Some("v" | "f"))
        };
        let (line, number) = lines.find(is_statement)?;
        let mut text = Cow::Borrowed(bare(line));
        while text.ends_with('\\') {
            let joined = text.to_mut();
            joined.pop();
            joined.push(' ');
            joined.push_str(lines.next().map_or("", |(line, _)| bare(line)));
        }
        Some(Statement { line: number, text })
    })
}

/// A line without its comment and the surrounding space. In `1.#QNAN` and `1.#INF`, as some programs write numbers that are
/// none, no comment begins: they must not be read as 1.
pub(super) fn bare(line: &str) -> &str {
    let mut marks = line.match_indices('#').map(|(place, _)| place);
    let comment = marks.find(|&place| !line[..place].ends_with("1."));
    line[..comment.unwrap_or(line.len())].trim()
}

/// The numbers of a vertex to pass to `tobj`: x, y, z and the weight that divides them.
pub(super) fn check_vertex<'a>(words: &[&'a str]) -> Result<[&'a str; 4], String> {
    let number = |word: &str| word.parse::<f32>().ok();
    let (&[x, y, z], after) = match words.split_first_chunk() {
        Some(split) if matches!(split.1.len(), 0 | 1 | 3 | 4) => split,
        _ => return Err(format!("has {} numbers; give it x, y and z", words.len())),
    };
    if ![x, y, z].into_iter().all(|word| number(word).is_some_and(f32::is_finite)) {
        return Err(format!("is at ({}, {}, {}); positions must be finite numbers", short(x), short(y), short(z)));
    }
    if let Some(word) = after.iter().find(|word| number(word).is_none()) {
        return Err(format!("has `{}` after x, y and z; that must be a weight or a color in numbers, or nothing", short(word)));
    }
    let &[weight] = after else { return Ok([x, y, z, "1"]) };
    let divided = |word| Some(number(word)? / number(weight)?);
    match number(weight) {
        Some(w) if w.is_finite() && [x, y, z].into_iter().all(|word| divided(word).is_some_and(f32::is_finite)) => {
            Ok([x, y, z, weight])
        }
        _ => Err(format!("has the weight {}, and positions divided by it must be finite; leave it out", short(weight))),
    }
}

/// `before` is the number of vertices before the face, from which negative indices count back.
pub(super) fn check_face(corners: &[&str], before: usize, vertices: usize) -> Result<(), String> {
    if corners.len() < 3 {
        return Err(format!("has {} corners; give it three or more", corners.len()));
    }
    corners.iter().try_for_each(|corner| {
        let mut parts = corner.split('/');
        let index = parts.next().and_then(|part| part.parse::<isize>().ok());
        // Texture and normal indices are not looked up, so they only need to be numbers.
        let rest = parts.clone().count() <= 2 && parts.all(|part| part.is_empty() || part.parse::<isize>().is_ok());
        match index.filter(|_| rest) {
            None => Err(format!("has the corner `{}`; write it as v, v/vt, v//vn or v/vt/vn", short(corner))),
            Some(0) => Err("names vertex 0; vertices are counted from 1".to_owned()),
            Some(index) if index > 0 && index.unsigned_abs() > vertices => {
                Err(format!("names vertex {index}, but the last one is {vertices} (counted from 1)"))
            }
            Some(index) if index < 0 && index.unsigned_abs() > before => {
                Err(format!("names vertex {index}, but only {before} come before it; count back from the face"))
            }
            Some(_) => Ok(()),
        }
    })
}

/// A word from a file, which may contain anything, made fit for an error message of one line.
fn short(word: &str) -> String {
    const LIMIT: usize = 32;
    let cut = word.chars().nth(LIMIT).map_or("", |_| "...");
    word.chars().take(LIMIT).flat_map(char::escape_debug).collect::<String>() + cut
}
