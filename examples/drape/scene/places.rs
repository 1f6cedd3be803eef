//! Where the values of a run were given: its failures name the line of the scene file and the key there, or the option.

use cloth_deformer::{BuildError, StepError};
use toml::Spanned;

use super::Scene;
use super::file::{File, Source};
use crate::arguments::Arguments;
use crate::{Failure, named};

/// Where the values of a run were given.
pub(super) struct Places {
    gravity: String,
    wind: String,
    /// The first cloth, whose fabric is the one that others are given by factors on.
    cloth: Option<String>,
    colliders: Vec<String>,
    /// Each pin, after the number of pinned vertices up to its last one.
    pins: Vec<(usize, String)>,
}

impl Places {
    pub(super) fn of(
        arguments: &Arguments,
        scene: Option<(&Source, &File)>,
        colliders: Vec<String>,
        pins: Vec<(usize, String)>,
    ) -> Places {
        fn place<T>(source: &Source, given: &Spanned<T>, what: &str) -> String {
            format!("{}: {what}", source.place(given.span().start))
        }
        let gravity = scene.and_then(|(source, file)| file.gravity.as_ref().map(|given| place(source, given, "gravity")));
        let wind = scene.and_then(|(source, file)| file.wind.as_ref().map(|given| place(source, given, "wind")));
        let name = |given: &Spanned<super::file::Cloth>| given.get_ref().name.clone().unwrap_or("cloth 1".to_owned());
        let cloth = scene.and_then(|(source, file)| file.cloth.first().map(|given| place(source, given, &name(given))));
        let or = |is_given: bool, option: &str, there: Option<String>| there.filter(|_| !is_given).unwrap_or(option.to_owned());
        Places {
            gravity: or(arguments.gravity.is_some(), "--gravity", gravity),
            wind: or(arguments.wind.is_some(), "--wind", wind),
            cloth,
            colliders,
            pins,
        }
    }

    /// Where an attribute of a step was given, and its key there.
    fn of_attribute<'a>(&self, name: &'a str) -> (String, &'a str) {
        let of_collider = || {
            let (number, key) = name.strip_prefix("colliders[")?.split_once("].")?;
            Some((self.colliders.get(number.parse::<usize>().ok()?)?.clone(), key))
        };
        let of_pin = || {
            let vertex = name.strip_prefix("pin_targets[")?.strip_suffix(']')?.parse::<usize>().ok()?;
            let (_, place) = self.pins.iter().find(|&&(end, _)| vertex < end)?;
            Some((place.clone(), "move"))
        };
        match name {
            "gravity" => (self.gravity.clone(), "gravity"),
            "wind" => (self.wind.clone(), "velocity"),
            "air_density" => (self.wind.clone(), "density"),
            "drag" | "lift" | "damping" => (self.wind.clone(), name),
            _ => of_pin().or_else(of_collider).unwrap_or(("the scene".to_owned(), name)),
        }
    }
}

impl Scene {
    /// A failed step, in terms of what was given instead of the library's.
    pub(crate) fn failed(&self, frame: i64, error: &StepError) -> Failure {
        let StepError::Attribute { name, value, remedy } = error else { return Failure::step(frame, error) };
        let (place, key) = self.places.of_attribute(name);
        Failure::input(format_args!("{place}: {}: `{key}` = {value} {remedy}", named(frame)))
    }

    /// A cloth that could not be built, likewise.
    pub(crate) fn not_built(&self, error: &BuildError) -> Failure {
        if let BuildError::Step { frame, error } = error {
            return self.failed((*frame).into(), error);
        }
        let is_of_fabric = matches!(error, BuildError::Value { name, .. } if name.starts_with("fabric."));
        let place = self.places.cloth.as_ref().filter(|_| is_of_fabric).unwrap_or(&self.name);
        Failure::build(place, error)
    }
}
