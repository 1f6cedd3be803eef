//! Values in a scene file: how they are read, and what is said of those that are not valid.

use std::fmt;
use std::marker::PhantomData;

use cloth_deformer::glam::Vec3;
use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};

/// A type that is read from numbers.
pub(crate) trait Value: Sized {
    /// Describes valid values in error messages.
    const WANTED: &'static str;

    fn from_numbers(numbers: &[f64]) -> Option<Self>;
}

/// A type that can be animated: its values can be interpolated.
pub(crate) trait Interpolated: Value + Copy + PartialEq {
    /// Interpolates between this value (share 0) and another (share 1).
    fn toward(self, other: Self, share: f32) -> Self;

    /// The value whose components are a function of those of some values.
    fn each<const N: usize>(values: [Self; N], of: impl Fn([f32; N]) -> f32) -> Self;
}

impl Value for Vec3 {
    const WANTED: &'static str = "three finite numbers [x, y, z]";

    fn from_numbers(numbers: &[f64]) -> Option<Vec3> {
        let &[x, y, z] = numbers else { return None };
        Some(Vec3::new(x as f32, y as f32, z as f32)).filter(|vector| vector.is_finite())
    }
}

impl Interpolated for Vec3 {
    fn toward(self, other: Vec3, share: f32) -> Vec3 {
        self.lerp(other, share)
    }

    fn each<const N: usize>(values: [Vec3; N], of: impl Fn([f32; N]) -> f32) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|axis| of(values.map(|value| value[axis]))))
    }
}

/// A vector whose components are all above 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Extent(pub(crate) Vec3);

impl Value for Extent {
    const WANTED: &'static str = "three finite numbers [x, y, z] above 0";

    fn from_numbers(numbers: &[f64]) -> Option<Extent> {
        Vec3::from_numbers(numbers).filter(|vector| vector.min_element() > 0.0).map(Extent)
    }
}

impl Interpolated for Extent {
    fn toward(self, other: Extent, share: f32) -> Extent {
        Extent(self.0.lerp(other.0, share))
    }

    fn each<const N: usize>(values: [Extent; N], of: impl Fn([f32; N]) -> f32) -> Extent {
        Extent(Vec3::each(values.map(|value| value.0), of))
    }
}

/// A unit vector, read from a vector of any length but 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Direction(pub(crate) Vec3);

impl Value for Direction {
    const WANTED: &'static str = "three finite numbers [x, y, z], not all of them 0";

    fn from_numbers(numbers: &[f64]) -> Option<Direction> {
        Vec3::from_numbers(numbers)?.try_normalize().map(Direction)
    }
}

/// Red, green and blue, each from 0 to 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Color(pub(crate) Vec3);

impl Value for Color {
    const WANTED: &'static str = "three numbers [red, green, blue] from 0 to 1";

    fn from_numbers(numbers: &[f64]) -> Option<Color> {
        Vec3::from_numbers(numbers).filter(|color| color.min_element() >= 0.0 && color.max_element() <= 1.0).map(Color)
    }
}

/// A number from 0 on, 0 included if `ZERO`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Size<const ZERO: bool>(pub(crate) f32);

impl NotNegative {
    pub(crate) const ZERO: NotNegative = Size(0.0);
}

impl<'de, const ZERO: bool> Deserialize<'de> for Size<ZERO> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Size<ZERO>, D::Error> {
        plain(deserializer)
    }
}

/// A number above 0.
pub(crate) type Positive = Size<false>;
/// A number that is 0 or above.
pub(crate) type NotNegative = Size<true>;

impl<const ZERO: bool> Value for Size<ZERO> {
    const WANTED: &'static str = if ZERO { "a finite number, 0 or above" } else { "a finite number above 0" };

    fn from_numbers(numbers: &[f64]) -> Option<Size<ZERO>> {
        let &[number] = numbers else { return None };
        let number = number as f32;
        (number.is_finite() && (number > 0.0 || ZERO && number == 0.0)).then_some(Size(number))
    }
}

impl<const ZERO: bool> Interpolated for Size<ZERO> {
    fn toward(self, other: Size<ZERO>, share: f32) -> Size<ZERO> {
        Size(self.0 + (other.0 - self.0) * share)
    }

    fn each<const N: usize>(values: [Size<ZERO>; N], of: impl Fn([f32; N]) -> f32) -> Size<ZERO> {
        Size(of(values.map(|value| value.0)))
    }
}

/// A whole number, at least `LEAST`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Whole<const LEAST: u32>(pub(crate) u32);

impl<'de, const LEAST: u32> Deserialize<'de> for Whole<LEAST> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Whole<LEAST>, D::Error> {
        deserializer.deserialize_any(WholeVisitor)
    }
}

struct WholeVisitor<const LEAST: u32>;

impl<const LEAST: u32> Visitor<'_> for WholeVisitor<LEAST> {
    type Value = Whole<LEAST>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number from {LEAST} to {}", u32::MAX)
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Whole<LEAST>, E> {
        let whole = u32::try_from(number).ok().filter(|&whole| whole >= LEAST);
        whole.map(Whole).ok_or_else(|| E::custom(format_args!("{number} is not a whole number from {LEAST} to {}", u32::MAX)))
    }
}

/// Parses a value that is not animated.
pub(crate) fn plain<'de, T: Value, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    let Numbers(numbers) = Numbers::deserialize(deserializer)?;
    checked(&numbers)
}

/// The value that numbers stand for.
pub(super) fn checked<T: Value, E: Error>(numbers: &[f64]) -> Result<T, E> {
    T::from_numbers(numbers).ok_or_else(|| match numbers {
        [number] => E::custom(format_args!("{number:?} is not {}", T::WANTED)),
        _ => E::custom(format_args!("{numbers:?} is not {}", T::WANTED)),
    })
}

/// [`plain`] for optional values.
pub(crate) fn maybe<'de, T: Value, D: Deserializer<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    plain(deserializer).map(Some)
}

/// A number, or a list of numbers.
struct Numbers(Vec<f64>);

impl<'de> Deserialize<'de> for Numbers {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Numbers, D::Error> {
        deserializer.deserialize_any(NumbersVisitor)
    }
}

struct NumbersVisitor;

impl<'de> Visitor<'de> for NumbersVisitor {
    type Value = Numbers;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, or a list of numbers in brackets, [.., ..]")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Numbers, E> {
        Ok(Numbers(vec![number]))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Numbers, E> {
        Ok(Numbers(vec![number as f64]))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Numbers, A::Error> {
        let mut numbers = Vec::new();
        while let Some(number) = items.next_element()? {
            numbers.push(number);
        }
        Ok(Numbers(numbers))
    }
}

/// Parses a list of tables.
pub(crate) fn tables<'de, T: Deserialize<'de>, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    let wanted = "a list, whose tables have two brackets: [[cloth]], [[cloth.pin]], [[collider]], [[vary]]";
    deserializer.deserialize_any(ListVisitor { wanted, items: PhantomData })
}

/// Parses a list of anything else.
pub(crate) fn list<'de, T: Deserialize<'de>, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_any(ListVisitor { wanted: "a list in brackets, [.., ..]", items: PhantomData })
}

/// [`list`] for optional ones.
pub(crate) fn maybe_list<'de, T: Deserialize<'de>, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<T>>, D::Error> {
    list(deserializer).map(Some)
}

struct ListVisitor<T> {
    wanted: &'static str,
    items: PhantomData<T>,
}

impl<'de, T: Deserialize<'de>> Visitor<'de> for ListVisitor<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.wanted)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Vec<T>, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(list)
    }
}
