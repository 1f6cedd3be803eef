//! Values that may change over time: their form in a scene file, and their value at a moment.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor, value::MapAccessDeserializer};

use super::timeline::Moment;
use super::values::{Interpolated, checked, maybe, plain};

/// A loop begins anew in a frame that is at most so long (s) before its end: the times of frames are rounded.
const NEAR: f64 = 1e-9;

/// Keys are taken to be at least so far apart (s) in the slopes of smooth curves, which are then finite.
const SHORTEST: f64 = 1e-100;

/// A value, or key frames of it.
///
/// Written as `value`, as `[{ time = 0, value = .. }, { time = 1.5, value = .. }]`, or, for a loop, as
/// `{ loop = true, keys = [..] }`. Times are in seconds from frame 1, in ascending order. Values are interpolated
/// linearly between keys, or without a jump of the velocity if `{ smooth = true, keys = [..] }`, and constant before the first and
/// after the last. `{ start = .., keys = [..] }` gives the value at the start of the preroll, in which it changes smoothly to that of
/// frame 1.
#[derive(Debug, Clone)]
pub(crate) struct Animated<T> {
    /// At least one.
    keys: Vec<Key<T>>,
    repeats: bool,
    is_smooth: bool,
    start: Option<T>,
}

#[derive(Debug, Clone, Copy, serde::Deserialize)]
#[serde(deny_unknown_fields, bound = "T: Interpolated")]
struct Key<T> {
    /// Seconds.
    time: Time,
    #[serde(deserialize_with = "plain")]
    value: T,
}

/// Seconds from frame 1.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
struct Time(f64);

impl<'de> Deserialize<'de> for Time {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Time, D::Error> {
        let time = f64::deserialize(deserializer)?;
        let error = || D::Error::custom(format_args!("time = {time} must be finite, and 0 s or later"));
        (time >= 0.0 && time.is_finite()).then_some(Time(time)).ok_or_else(error)
    }
}

impl<T: Interpolated> Animated<T> {
    /// The same value at all times.
    pub(crate) fn still(value: T) -> Animated<T> {
        Animated { keys: vec![Key { time: Time(0.0), value }], repeats: false, is_smooth: false, start: None }
    }

    /// The value at a moment.
    pub(super) fn at(&self, moment: Moment) -> T {
        match self.start {
            Some(start) if moment.share < 1.0 => start.toward(self.at_time(0.0), moment.share),
            _ => self.at_time(moment.time),
        }
    }

    /// The value at `time` (s) from frame 1.
    fn at_time(&self, time: f64) -> T {
        let time = self.within(time).0;
        let place = self.keys.partition_point(|key| key.time.0 <= time);
        match (place.checked_sub(1).map(|last| self.keys[last]), self.keys.get(place)) {
            (None, _) => self.keys[0].value,
            (Some(last), None) => last.value,
            (Some(last), Some(next)) => {
                let share = ((time - last.time.0) / (next.time.0 - last.time.0)) as f32;
                if self.is_smooth { self.curve(place - 1, share) } else { last.value.toward(next.value, share) }
            }
        }
    }

    /// The value on a curve from key `last` (share 0) to the next (share 1): a cubic that has the same slope on either side of each
    /// key, and stays between its ends.
    fn curve(&self, last: usize, share: f32) -> T {
        let intervals = [self.before(last), Some(last), self.after(last)];
        let width = |key: usize| (self.keys[key + 1].time.0 - self.keys[key].time.0).max(SHORTEST);
        let widths = intervals.map(|interval| width(interval.unwrap_or(last)));
        let [[a, b], [c, d], [e, f]] = intervals
            .map(|interval| interval.map_or([self.keys[last].value; 2], |key| [self.keys[key].value, self.keys[key + 1].value]));
        T::each([a, b, c, d, e, f], |values| {
            let [a, b, from, to, e, f] = values.map(f64::from);
            let [before, mean, after] = [(b - a) / widths[0], (to - from) / widths[1], (f - e) / widths[2]];
            let slopes = [slope([before, mean], [widths[0], widths[1]]), slope([mean, after], [widths[1], widths[2]])];
            let [start, end] = slopes.map(|slope| slope * widths[1]);
            let (s, t) = (f64::from(share), 1.0 - f64::from(share));
            let value = t * t * (from + s * (2.0 * from + start)) + s * s * (to + t * (2.0 * to - end));
            value.clamp(from.min(to), from.max(to)) as f32
        })
    }

    /// The interval before the one that begins at a key, by the key that it begins at; `None` where the value was constant. A loop goes
    /// on at its other end, or if it does not close, as in the interval itself.
    fn before(&self, key: usize) -> Option<usize> {
        if key > 0 { Some(key - 1) } else { self.repeats.then_some(if self.closes() { self.keys.len() - 2 } else { key }) }
    }

    /// The interval after that, likewise.
    fn after(&self, key: usize) -> Option<usize> {
        let is_last = key + 2 == self.keys.len();
        if is_last { self.repeats.then_some(if self.closes() { 0 } else { key }) } else { Some(key + 1) }
    }

    /// Whether the last value is the first.
    fn closes(&self) -> bool {
        self.keys[0].value == self.keys[self.keys.len() - 1].value
    }

    /// Whether a value is given for the start of the preroll.
    pub(super) fn has_start(&self) -> bool {
        self.start.is_some()
    }

    /// The same with this value at the start of the preroll, unless one is given.
    pub(super) fn starting_at(self, value: T) -> Animated<T> {
        Animated { start: self.start.or(Some(value)), ..self }
    }

    /// The values of all keys, and that of the start.
    pub(super) fn values(&self) -> impl Iterator<Item = T> {
        self.keys.iter().map(|key| key.value).chain(self.start)
    }

    /// Whether a loop whose last value differs from its first restarted between two times (s).
    pub(crate) fn jumps(&self, from: f64, to: f64) -> bool {
        self.jumps_unless(from, to, |first, last| first == last)
    }

    /// [`Animated::jumps`] for values that may be the same though their numbers differ, such as angles of 0 and 360
    /// degrees.
    pub(super) fn jumps_unless(&self, from: f64, to: f64, are_same: impl Fn(T, T) -> bool) -> bool {
        self.within(from).1 != self.within(to).1 && !are_same(self.keys[0].value, self.keys[self.keys.len() - 1].value)
    }

    /// The time within the keys, and the number of completed loops.
    fn within(&self, time: f64) -> (f64, f64) {
        let (first, last) = (self.keys[0].time.0, self.keys[self.keys.len() - 1].time.0);
        if !self.repeats || time < first || last <= first {
            return (time, 0.0);
        }
        let rounds = ((time + NEAR - first) / (last - first)).floor();
        ((time - rounds * (last - first)).clamp(first, last), rounds)
    }

    fn from_keys<E: Error>(keys: Vec<Key<T>>, repeats: bool) -> Result<Animated<T>, E> {
        if keys.is_empty() {
            return Err(E::custom("there are no keys; give at least one { time = .., value = .. }"));
        }
        if let Some(pair) = keys.windows(2).find(|pair| pair[1].time <= pair[0].time) {
            let [Time(last), Time(next)] = [pair[0].time, pair[1].time];
            return Err(E::custom(format_args!(
                "a key at {next} s comes after one at {last} s; put them in the order of their times"
            )));
        }
        Ok(Animated { keys, repeats, is_smooth: false, start: None })
    }
}

/// The slope at a key, between intervals with these mean slopes and widths, of a curve that is as monotonic as the keys (Fritsch and
/// Butland 1984).
fn slope([before, after]: [f64; 2], [width, next_width]: [f64; 2]) -> f64 {
    if before * after <= 0.0 {
        return 0.0;
    }
    let weights = [2.0 * next_width + width, next_width + 2.0 * width];
    (weights[0] + weights[1]) / (weights[0] / before + weights[1] / after)
}

impl<'de, T: Interpolated> Deserialize<'de> for Animated<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Animated<T>, D::Error> {
        deserializer.deserialize_any(AnimatedVisitor(std::marker::PhantomData))
    }
}

struct AnimatedVisitor<T>(std::marker::PhantomData<T>);

impl<'de, T: Interpolated> Visitor<'de> for AnimatedVisitor<T> {
    type Value = Animated<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, or keys [{{ time = .., value = .. }}, ..]", T::WANTED)
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Animated<T>, E> {
        value(&[number])
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Animated<T>, E> {
        value(&[number as f64])
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Animated<T>, A::Error> {
        let (mut numbers, mut keys) = (Vec::new(), Vec::new());
        while let Some(item) = items.next_element::<Item<T>>()? {
            match item {
                Item::Number(number) => numbers.push(number),
                Item::Key(key) => keys.push(key),
            }
        }
        match keys.is_empty() {
            true => value(&numbers),
            false if numbers.is_empty() => Animated::from_keys(keys, false),
            false => Err(A::Error::custom("it has numbers among its keys; give one or the other")),
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Animated<T>, A::Error> {
        let Track { keys, repeats, is_smooth, start } = Track::deserialize(MapAccessDeserializer::new(map))?;
        Ok(Animated { is_smooth, start, ..Animated::from_keys(keys, repeats)? })
    }
}

fn value<T: Interpolated, E: Error>(numbers: &[f64]) -> Result<Animated<T>, E> {
    checked(numbers).map(Animated::still)
}

/// Key frames that may loop, and the value at the start of the preroll.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields, bound = "T: Interpolated")]
struct Track<T> {
    keys: Vec<Key<T>>,
    #[serde(rename = "loop", default)]
    repeats: bool,
    #[serde(rename = "smooth", default)]
    is_smooth: bool,
    #[serde(default = "none", deserialize_with = "maybe")]
    start: Option<T>,
}

fn none<T>() -> Option<T> {
    None
}

/// An item of a list: a number or a key.
enum Item<T> {
    Number(f64),
    Key(Key<T>),
}

impl<'de, T: Interpolated> Deserialize<'de> for Item<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Item<T>, D::Error> {
        deserializer.deserialize_any(ItemVisitor(std::marker::PhantomData))
    }
}

struct ItemVisitor<T>(std::marker::PhantomData<T>);

impl<'de, T: Interpolated> Visitor<'de> for ItemVisitor<T> {
    type Value = Item<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number or a key { time = .., value = .. }")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Item<T>, E> {
        Ok(Item::Number(number))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Item<T>, E> {
        Ok(Item::Number(number as f64))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Item<T>, A::Error> {
        Key::deserialize(MapAccessDeserializer::new(map)).map(Item::Key)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Item<T>, A::Error> {
        while items.next_element::<IgnoredAny>()?.is_some() {}
        Err(A::Error::custom("a list in a list; a key is written { time = .., value = .. }"))
    }
}
