//! The statements of an OBJ, and what they may be.

use std::ops::Range;

/// A `v`, `vt`, `vn` or `f` statement.
pub(super) struct Statement<'a> {
    /// The line on which it begins.
    pub line: usize,
    pub keyword: &'a str,
    /// From its first line to its last one, with comments.
    text: &'a str,
}

impl<'a> Statement<'a> {
    pub(super) fn is_vertex(&self) -> bool {
        self.keyword == "v"
    }

    /// Whether it says where cloth is.
    pub(super) fn is_of_mesh(&self) -> bool {
        is_of_mesh(self.keyword)
    }

    /// Its words after the keyword.
    pub(super) fn words(&self) -> impl Iterator<Item = &'a str> + use<'a> {
        self.text.lines().map(bare).flat_map(|line| uncontinued(line).split_whitespace()).skip(1)
    }
}

fn is_of_mesh(keyword: &str) -> bool {
    matches!(keyword, "v" | "f")
}

/// Whether a statement with this keyword and a `\` at its end goes on in the next line. Texture coordinates and normals do only if
/// numbers follow: a stray `\` must not swallow a vertex or a face. Statements with other keywords never go on, because a path or a
/// comment may end in `\`.
fn goes_on(keyword: &str, next: &str) -> bool {
    is_of_mesh(keyword) || bare(next).split_whitespace().next().is_some_and(|word| word.parse::<f32>().is_ok())
}

/// A line without the `\` by which it is continued.
fn uncontinued(line: &str) -> &str {
    line.strip_suffix('\\').unwrap_or(line)
}

/// The text's `v`, `vt`, `vn` and `f` statements, without comments and with continued lines joined.
pub(super) fn statements(text: &str) -> impl Iterator<Item = Statement<'_>> {
    // `tobj` would read a byte order mark as part of the first word, and lose that vertex.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.lines().zip(1..);
    std::iter::from_fn(move || {
        let (first, line, keyword) = lines.find_map(|(line, number)| {
            let keyword = uncontinued(bare(line)).split_whitespace().next();
            let keyword = keyword.filter(|keyword| matches!(*keyword, "v" | "vt" | "vn" | "f"));
            Some((line, number, keyword?))
        })?;
        let mut last = first;
        while bare(last).ends_with('\\') {
            let Some((next, _)) = lines.clone().next().filter(|(next, _)| goes_on(keyword, next)) else { break };
            lines.next();
            last = next;
        }
        let text = &text[place(text, first).start..place(text, last).end];
        Some(Statement { line, keyword, text })
    })
}

/// The place in a text of a part of it.
pub(super) fn place(text: &str, part: &str) -> Range<usize> {
    let start = part.as_ptr() as usize - text.as_ptr() as usize;
    start..start + part.len()
}

/// A line without its comment and the surrounding space. In `1.#QNAN` and `1.#INF`, as some programs write numbers that are
/// none, no comment begins: they must not be read as 1.
fn bare(line: &str) -> &str {
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
