//! Snapshots: their content, their encoding, and how a motion continues from one.

use glam::{Vec3, Vec4};

use super::{Deformer, State};
use crate::deformer::imperfection::FlatStart;
use crate::error::{StateError, StepError};
use crate::kernels::limits::is_bounded;
use crate::kernels::statistics::Statistics;
use crate::model::csr::distinct;
use crate::options::Options;
use crate::past::Past;
use crate::record::{Hash, Recorded, recorded};
use crate::step::motion::Ambient;

/// The first bytes of a snapshot, and the version of the format.
const NAME: [u8; 8] = *b"CLOTHRUN";
const VERSION: u32 = 16;
/// Sizes (bytes) of name and version together, and of the hash at the end.
const HEAD: usize = NAME.len() + size_of::<u32>();
const END: usize = size_of::<u64>();

/// The state of a motion: everything that its next steps depend on. Created by [`Deformer::snapshot`].
///
/// A snapshot does not contain the mesh and the options, only hashes of them. It takes 24 bytes per vertex and a few
/// thousand bytes more; with [`Options::contact`] 52 more bytes per vertex and 24 per listed pair; with mesh colliders some
/// hundred bytes per vertex of theirs, since it has their places in several moments. Its bytes can be
/// stored in a file and restored elsewhere: numbers are little-endian, and a hash at the end detects truncated or
/// altered files. With the `serde` feature it implements `Serialize` and `Deserialize` as those bytes.
///
/// ```
/// # use cloth_deformer::{Attributes, Backend, Deformer, Mesh, Options, Snapshot};
/// let (mesh, scene) = (Mesh::grid(8, 8, 1.0, 1.0), Attributes::default());
/// let options = Options { backend: Backend::Cpu, pinned: vec![0, 7], ..Options::default() };
/// let mut cloth = Deformer::new(&mesh, options.clone())?;
/// cloth.step(1.0 / 60.0, &scene)?;
/// let bytes = cloth.snapshot()?.to_bytes();
/// cloth.step(1.0 / 60.0, &scene)?;
///
/// let mut other = Deformer::new(&mesh, options)?;
/// other.restore(&Snapshot::from_bytes(&bytes)?)?;
/// other.step(1.0 / 60.0, &scene)?;
/// assert_eq!(other.positions()?, cloth.positions()?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, PartialEq, Eq)]
pub struct Snapshot {
    /// Encoded and verified: either made here or decoded once.
    bytes: Vec<u8>,
}

impl std::fmt::Debug for Snapshot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Snapshot({} bytes)", self.bytes.len())
    }
}

impl Snapshot {
    /// The bytes for [`Snapshot::from_bytes`].
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        self.bytes.clone()
    }

    /// Reads the bytes from [`Snapshot::to_bytes`].
    ///
    /// # Errors
    /// [`StateError::Foreign`], [`StateError::Version`] or [`StateError::Altered`] if they are not exactly the bytes
    /// that [`Snapshot::to_bytes`] returned, in this version of the format.
    pub fn from_bytes(bytes: &[u8]) -> Result<Snapshot, StateError> {
        decode(bytes)?;
        Ok(Snapshot { bytes: bytes.to_vec() })
    }

    fn encode(mut content: Content) -> Snapshot {
        let mut bytes = [&NAME[..], &VERSION.to_le_bytes(), &content.to_tape()].concat();
        bytes.extend(Hash::NOTHING.with(&bytes).0.to_le_bytes());
        Snapshot { bytes }
    }
}

fn decode(bytes: &[u8]) -> Result<Content, StateError> {
    if !bytes.starts_with(&NAME) {
        return Err(StateError::Foreign);
    }
    let (head, rest) = bytes.split_at_checked(HEAD).ok_or(StateError::Altered)?;
    let version = u32::from_le_bytes(std::array::from_fn(|k| head[NAME.len() + k]));
    if version != VERSION {
        return Err(StateError::Version { found: version, known: VERSION });
    }
    let (content, hash) = rest.split_last_chunk::<END>().ok_or(StateError::Altered)?;
    if Hash::NOTHING.with(&bytes[..bytes.len() - END]).0.to_le_bytes() != *hash {
        return Err(StateError::Altered);
    }
    Content::from_tape(content).map_err(|_| StateError::Altered)
}

/// The content of a snapshot.
#[derive(Debug, Default)]
struct Content {
    /// The hashes of mesh and options: see [`Deformer::identity`].
    identity: Vec<u64>,
    /// SIMD lanes of the processor; `None` if it computed nothing.
    lanes: Option<u32>,
    /// Positions (m) and displacements (m), in the solver's vertex order.
    x: Vec<Vec3>,
    p: Vec<Vec3>,
    engine: Past,
    state: State,
}

recorded!(Content { identity, lanes, x, p, engine, state });
recorded!(State { motion, controller, awaiting_statistics, seen, pace, still, looks, watch, bounds, gravity });

impl Deformer {
    /// Captures the state of the motion. Steps after [`Deformer::restore`] are the same, bit for bit, as the steps that
    /// follow this call.
    ///
    /// This holds for the same version of the crate and the same steps (`dt` and attributes), on any number of threads.
    /// With [`Backend::Cpu`](crate::Backend::Cpu) and `Hybrid` the processor must have the same number of SIMD lanes
    /// (sixteen with AVX-512, eight with AVX2, four otherwise; [`StateError::Lanes`] reports a mismatch), with `Gpu`
    /// and `Hybrid` the same kind of GPU. [`Quality::Budget`](crate::Quality::Budget) depends on the clock and never
    /// repeats.
    ///
    /// This takes about as long as a step of few substeps. On a GPU it waits for the submitted steps and reads the
    /// state back.
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn snapshot(&mut self) -> Result<Snapshot, StepError> {
        let [x, p] = self.read_state()?.map(|vectors| vectors.iter().map(|v| v.truncate()).collect());
        let engine = self.engine.past().map_err(|failure| self.failed(failure))?;
        let identity = self.identity().iter().map(|(_, hash)| hash.0).collect();
        let lanes = self.engine.lanes().map(|lanes| lanes as u32);
        Ok(Snapshot::encode(Content { identity, lanes, x, p, engine, state: self.state.clone() }))
    }

    /// Continues from a snapshot of this cloth, or of another one with the same mesh and options. Takes about as long
    /// as making the snapshot. If fabric, masses, pins or quality were changed since, change them back before.
    ///
    /// # Errors
    /// [`StateError::Other`] if the mesh or an option differs, [`StateError::Lanes`] if the processor rounds
    /// differently, [`StateError::Altered`] if the content is impossible, and [`StateError::Step`] if the GPU was lost.
    /// The state is then unchanged.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), StateError> {
        let content = decode(&snapshot.bytes)?;
        let own = self.identity();
        if content.identity.len() != own.len() {
            return Err(StateError::Altered);
        }
        if let Some(((what, _), _)) = own.iter().zip(&content.identity).find(|((_, own), other)| own.0 != **other) {
            return Err(StateError::Other { what });
        }
        let here = self.engine.lanes().map(|lanes| lanes as u32);
        if let (Some(taken), Some(here)) = (content.lanes, here)
            && taken != here
        {
            return Err(StateError::Lanes { taken, here });
        }
        if !self.fits(&content) {
            return Err(StateError::Altered);
        }
        let Content { x, p, engine, state, .. } = content;
        let x: Vec<Vec4> = x.iter().zip(&self.cloth.rest).map(|(x, rest)| x.extend(rest.w)).collect();
        let mut p: Vec<Vec4> = p.iter().map(|p| p.extend(state.motion.h)).collect();
        self.cloth.stop_loose(&mut p);
        let resumed = self.engine.resume(&self.cloth, &self.options, [&x, &p], &engine);
        if !resumed.map_err(|failure| StateError::Step(self.failed(failure)))? {
            return Err(StateError::Altered);
        }
        self.state = State { watch: self.state.watch.with_past(&state.watch), ..state };
        let is_placed = self.state.motion.dt == 0.0 && self.state.motion.h == 0.0;
        self.flat_start = if is_placed { FlatStart::placed(&x, &p, &self.cloth) } else { None };
        (self.is_current, self.has_arrived) = (false, false);
        Ok(())
    }

    /// Whether the content can belong to this cloth.
    fn fits(&self, content: &Content) -> bool {
        let (vertices, pins) = (self.cloth.rest.len(), self.cloth.pinned.len());
        let Content { x, p, engine, state: State { motion, awaiting_statistics, seen, .. }, .. } = content;
        let counts = |seen: &Statistics| seen.speed.iter().map(|&count| u64::from(count)).sum::<u64>() <= vertices as u64;
        [x.len(), p.len()] == [vertices; 2]
            && x.iter().chain(p).all(|v| is_bounded(*v))
            && motion.h >= 0.0
            && motion.dt >= 0.0
            && motion.course.is_finite()
            && motion.ambient.as_ref().is_none_or(Ambient::is_finite)
            && motion.pins.len() == pins
            && [0, pins].contains(&motion.pin_velocities.len())
            && awaiting_statistics.len() == engine.pending.len()
            && seen.iter().chain(&engine.pending).all(counts)
    }

    /// Hashes of the mesh and of each option that the state depends on, with their names.
    fn identity(&self) -> [(&'static str, Hash); 13] {
        // Listing every field makes the author of a new option decide here whether a state depends on it.
        let Options {
            backend: _,
            gpu: _,
            mass: _,
            method,
            quality,
            levels,
            sleep,
            tethers,
            fabric,
            pinned,
            edge_scale,
            bending_scale,
            contact,
        } = &self.options;
        let said = |value: &dyn std::fmt::Debug| Hash::NOTHING.with(format!("{value:?}").as_bytes());
        let cloth = &self.cloth;
        let shape = cloth.rest.iter().fold(said(&cloth.origin), |hash, x| hash.with(bytemuck::bytes_of(&x.truncate())));
        let mesh = shape.with(bytemuck::cast_slice(&cloth.order)).with(bytemuck::cast_slice(&cloth.triangles));
        // Threads are edges without triangles. The order of all edges depends on the pins, too.
        let edges = distinct(cloth.links.iter().map(|link| link.ends).collect());
        let mesh = mesh.with(bytemuck::cast_slice(&edges));
        let list = |list: &[f32]| Hash::NOTHING.with(bytemuck::cast_slice(list));
        [
            ("mesh", mesh),
            ("backend", said(&self.backend())),
            ("method", said(method)),
            ("quality", said(quality)),
            ("levels", said(levels)),
            ("sleep", said(sleep)),
            ("tethers", said(tethers)),
            ("fabric", said(fabric)),
            ("pinned", Hash::NOTHING.with(bytemuck::cast_slice(pinned))),
            ("mass", list(&cloth.mass)),
            ("edge_scale", edge_scale.as_deref().map_or(Hash::NOTHING, list)),
            ("bending_scale", bending_scale.as_deref().map_or(Hash::NOTHING, list)),
            ("contact", said(contact)),
        ]
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for Snapshot {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.bytes)
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Snapshot {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Snapshot, D::Error> {
        deserializer.deserialize_byte_buf(BytesVisitor)
    }
}

/// Accepts bytes, or a sequence of numbers in formats without bytes.
#[cfg(feature = "serde")]
struct BytesVisitor;

#[cfg(feature = "serde")]
impl<'de> serde::de::Visitor<'de> for BytesVisitor {
    type Value = Snapshot;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("the bytes of a snapshot")
    }

    fn visit_bytes<E: serde::de::Error>(self, bytes: &[u8]) -> Result<Snapshot, E> {
        Snapshot::from_bytes(bytes).map_err(E::custom)
    }

    fn visit_seq<A: serde::de::SeqAccess<'de>>(self, mut numbers: A) -> Result<Snapshot, A::Error> {
        let mut bytes = Vec::new();
        while let Some(byte) = numbers.next_element::<u8>()? {
            bytes.push(byte);
        }
        Snapshot::from_bytes(&bytes).map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
#[path = "../../tests/unit/deformer_snapshot.rs"]
mod tests;
