//! A run: the cloth, its options, and what acts on it in each frame, from the command line and the scene file.

mod air;
mod bodies;
mod cloths;
mod colliders;
mod fabrics;
pub(crate) mod file;
mod keys;
mod pins;
mod places;
mod timeline;
mod values;

use std::path::PathBuf;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Contact, Levels, Mesh, Method, ObjTemplate, Options, Quality, Tethers, UpAxis};
use toml::Spanned;

use crate::Failure;
use crate::arguments::{Arguments, Format};
use crate::command::warn;
use crate::output::Outputs;
use crate::preview::{Look, default_view};
use crate::sweep;
use cloths::Cloths;
pub(crate) use colliders::replacing;
use colliders::{Moving, colliders};
use file::{File, Source, Wind};
use keys::Animated;
use pins::Group;
use places::Places;
use timeline::{NO_PREROLL, Timeline};

/// File extensions of pictures and films that are not PNG files.
const OTHER_PICTURES: [&str; 10] = ["jpg", "jpeg", "gif", "webp", "bmp", "tif", "tiff", "svg", "mp4", "mov"];

/// Most substeps per 1/60 s.
const MAX_SUBSTEPS: u32 = 65536;

/// Strongest gusts, relative to the wind.
const MAX_STRENGTH: f32 = 1e6;

/// Everything that a run needs.
pub(crate) struct Scene {
    /// Name of the mesh in error messages.
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    /// The file that the mesh was read from, if it is a single file.
    pub(crate) template: Option<ObjTemplate>,
    /// Whether any cloth has texture coordinates.
    pub(crate) is_textured: bool,
    pub(crate) options: Options,
    /// Whether cloth that crosses is separated, before the first frame and every 0.2 s later.
    pub(crate) untangle: bool,
    pub(crate) outputs: Outputs,
    pub(crate) look: Look,
    pub(crate) timeline: Timeline,
    gravity: Animated<Vec3>,
    wind: Option<Wind>,
    colliders: Vec<Moving>,
    pins: Vec<Group>,
    places: Places,
}

impl Scene {
    pub(crate) fn new(arguments: &Arguments) -> Result<Scene, Failure> {
        let read = arguments.scene.as_deref().map(Source::read).transpose()?;
        if let Some((_, file)) = read.as_ref().filter(|_| !arguments.quiet) {
            sweep::note(file);
        }
        Scene::of(arguments, read.as_ref().map(|(source, file)| (source, file)))
    }

    /// Builds a scene from a parsed scene file.
    pub(crate) fn of(arguments: &Arguments, scene: Option<(&Source, &File)>) -> Result<Scene, Failure> {
        let usual = File::default();
        let file = scene.map_or(&usual, |(_, file)| file);

        let timeline = Timeline::of(arguments, scene)?;
        let gravity = gravity(arguments, scene, timeline)?;
        let up = UpAxis::of(gravity.at(timeline.moment(timeline.first())));
        let Cloths { name, mesh, template, is_textured, materials, pins, pin_places, pieces, mut files } = match scene {
            Some((source, file)) => Cloths::of_scene(arguments, source, file, timeline, up)?,
            None => Cloths::of_arguments(arguments, up)?,
        };
        files.extend(arguments.scene.clone());
        let (of_colliders, colliders): (_, Vec<Moving>) = colliders(arguments, scene, &mesh, timeline, up)?.into_iter().unzip();
        let ends = pins.iter().scan(0, |end, group| {
            *end += group.vertices.len();
            Some(*end)
        });
        let places = Places::of(arguments, scene, of_colliders, ends.zip(pin_places).collect());
        files.extend(colliders.iter().flat_map(Moving::files).cloned());
        let wind = wind(arguments, scene, timeline)?;
        let backend = arguments.backend.or(file.backend).unwrap_or_default();
        let fabrics = fabrics::combine(&mesh, &materials).map_err(|(number, why)| match scene {
            Some((source, file)) => source.wrong_in(&file.cloth[number], format_args!("cloth {}: {why}", number + 1)),
            None => Failure::input(why),
        })?;
        let options = Options {
            backend,
            fabric: fabrics.fabric,
            mass: fabrics.mass,
            edge_scale: fabrics.edge_scale,
            bending_scale: fabrics.bending_scale,
            pinned: pins.iter().flat_map(|group| group.vertices.iter().copied()).collect(),
            contact: contact(arguments, file, &mesh),
            ..solver(arguments, scene)?
        };
        let untangle = arguments.untangle || file.contact.as_ref().is_some_and(|contact| contact.get_ref().untangle);
        Ok(Scene {
            name,
            mesh,
            template,
            is_textured,
            options,
            untangle,
            outputs: outputs(arguments, file, timeline, files)?,
            look: Look {
                from: file.picture.from.map_or_else(|| default_view(up), |from| from.0),
                up,
                begin: file.picture.begin.map_or(0.0, |begin| begin.0),
                pieces,
            },
            timeline,
            gravity,
            wind,
            colliders,
            pins,
            places,
        })
    }

    /// Length of a frame (s).
    pub(crate) fn dt(&self) -> f32 {
        1.0 / self.outputs.fps
    }

    /// The number of frames from one frame of the animation to the next, so that it has at most 30 per second.
    pub(crate) fn animated_every(&self) -> u32 {
        (self.outputs.fps / 30.0).ceil().max(1.0) as u32
    }

    /// Whether the animation contains a frame.
    pub(crate) fn is_animated(&self, frame: u32) -> bool {
        let first = (1.0 + (self.look.begin * self.outputs.fps).ceil()).min(self.outputs.frames as f32) as u32;
        frame >= first && (frame - first).is_multiple_of(self.animated_every())
    }

    /// The number of frames after which cloth that crosses is separated again.
    pub(crate) fn untangled_every(&self) -> i64 {
        (0.2 / self.dt()).round().max(1.0) as i64
    }

    /// Describes everything that acts on the cloth up to a frame. A run can be resumed after that frame only if this text is
    /// unchanged.
    pub(crate) fn acts(&self, frame: i64) -> String {
        let Scene { gravity, wind, colliders, pins, untangle, timeline, .. } = self;
        let led: Vec<&Group> = pins.iter().filter(|group| group.moves()).collect();
        let parted = if *untangle { " untangled" } else { "" };
        let preroll = timeline.preroll;
        let moment = timeline.moment(frame);
        let bodies: Vec<String> = colliders.iter().filter_map(Moving::body).map(|body| body.until(moment)).collect();
        format!("{:?} {preroll} {gravity:?} {wind:?} {colliders:?} {bodies:?} {led:?}{parted}", self.dt())
    }

    /// The attributes of the step that leads to a frame. The preroll has frames before 1.
    pub(crate) fn attributes(&self, frame: i64) -> Attributes {
        let [last, moment] = [frame - 1, frame].map(|frame| self.timeline.moment(frame));
        let halfway = self.timeline.before(frame);
        let is_led = self.pins.iter().any(Group::moves);
        let attributes = Attributes {
            gravity: self.gravity.at(halfway),
            colliders: self.colliders.iter().map(|moving| moving.at(moment, last)).collect(),
            pin_targets: is_led.then(|| self.pins.iter().flat_map(|group| group.at(moment)).collect()),
            ..Attributes::default()
        };
        match &self.wind {
            Some(wind) => wind.blow(halfway, self.look.up, attributes),
            None => attributes,
        }
    }
}

/// Gravity. That of the command line replaces the file's.
fn gravity(arguments: &Arguments, scene: Option<(&Source, &File)>, timeline: Timeline) -> Result<Animated<Vec3>, Failure> {
    let given = scene.and_then(|(source, file)| file.gravity.as_ref().map(|gravity| (source, gravity)));
    match (arguments.gravity, given) {
        (Some(gravity), _) => Ok(Animated::still(gravity)),
        (None, Some((source, gravity))) if timeline.preroll == 0 && gravity.get_ref().has_start() => {
            Err(source.wrong_in(gravity, NO_PREROLL))
        }
        (None, Some((_, gravity))) => Ok(gravity.get_ref().clone()),
        (None, None) => Ok(Animated::still(Attributes::default().gravity)),
    }
}

/// The air. A velocity on the command line replaces the file's.
fn wind(arguments: &Arguments, scene: Option<(&Source, &File)>, timeline: Timeline) -> Result<Option<Wind>, Failure> {
    let given = scene.and_then(|(source, file)| file.wind.as_ref().map(|wind| (source, wind)));
    if let Some((source, wind)) = given
        && let (lift, drag) = (wind.get_ref().lift, wind.get_ref().drag)
        && let Some(lift) = lift.filter(|lift| lift.0 > drag.map_or(Attributes::default().drag, |drag| drag.0))
    {
        return Err(source.wrong_in(wind, format_args!("lift = {} must not exceed drag", lift.0)));
    }
    if let Some((source, wind)) = given
        && let Some(gusts) = wind.get_ref().gusts.as_ref().filter(|gusts| gusts.strength.0 > MAX_STRENGTH)
    {
        let what = format_args!("gusts.strength = {} must be at most {MAX_STRENGTH} times the wind", gusts.strength.0);
        return Err(source.wrong_in(wind, what));
    }
    if let Some((source, wind)) = given
        && timeline.preroll == 0
        && arguments.wind.is_none()
        && wind.get_ref().velocity.has_start()
    {
        return Err(source.wrong_in(wind, NO_PREROLL));
    }
    let wind = given.map(|(_, wind)| wind.get_ref().clone());
    Ok(match (arguments.wind, wind) {
        (None, wind) => wind,
        (Some(velocity), None) => Some(Wind::steady(velocity)),
        (Some(velocity), Some(wind)) => Some(Wind { velocity: Animated::still(velocity), ..wind }),
    })
}

/// Warns if the cloth is kept farther apart than its edges are long: very many pairs are near then, for the same picture.
fn contact(arguments: &Arguments, file: &File, mesh: &Mesh) -> Option<Contact> {
    let usual = Contact::default();
    let given = file.contact.as_ref().map(Spanned::get_ref);
    let thickness = given.map(|contact| contact.thickness.map_or(usual.thickness, |thickness| thickness.0));
    let friction = given.and_then(|contact| contact.friction).map_or(usual.friction, |friction| friction.0);
    let thickness = arguments.self_contact.or(thickness)?;
    let edges = mesh.edges();
    let length = |[a, b]: &[u32; 2]| mesh.positions[*a as usize].distance(mesh.positions[*b as usize]);
    let edge = edges.iter().map(length).sum::<f32>() / edges.len().max(1) as f32;
    if edge > 0.0 && thickness > edge {
        let message = format!(
            "cloth is kept {thickness} m apart, farther than its edges are long ({:.2} mm), which is slow; {:.2} mm would do (`--self-contact`, or `thickness` in [contact])",
            1e3 * edge,
            400.0 * edge,
        );
        warn("warning", &message);
    }
    Some(Contact { thickness, friction: arguments.friction.unwrap_or(friction) })
}

/// Method, quality, levels and tethers.
fn solver(arguments: &Arguments, scene: Option<(&Source, &File)>) -> Result<Options, Failure> {
    let given: Option<(&Source, &Spanned<file::Quality>)> =
        scene.and_then(|(source, file)| file.quality.as_ref().map(|quality| (source, quality)));
    let usual = file::Quality::default();
    let file = given.map_or(&usual, |(_, quality)| quality.get_ref());
    let wrong = |what: &str| match given {
        Some((source, quality)) => source.wrong_in(quality, what),
        None => Failure::input(what),
    };

    let substeps = file.substeps.map(|count| Quality::Substeps(count.0));
    let holding = |stretch: f32| match &file.share {
        Some(share) => Quality::Hold { stretch, share: share.0 },
        None => Quality::Strain(stretch),
    };
    let strain = file.strain.map(|strain| holding(strain.0));
    let budget = file.budget.map(|budget| Quality::Budget(budget.0));
    let named: Vec<Quality> = [substeps, strain, budget].into_iter().flatten().collect();
    if named.len() > 1 || (file.share.is_some() && strain.is_none()) {
        return Err(wrong("give one of substeps, strain and budget, and a share to a strain alone"));
    }
    if let Some(count) = file.substeps.filter(|count| count.0 > MAX_SUBSTEPS) {
        return Err(wrong(&format!("substeps = {}; must be from 1 to 65536", count.0)));
    }
    if let Some(share) = file.share.filter(|share| !(0.5..=1.0).contains(&share.0)) {
        return Err(wrong(&format!("share = {}; must be from 0.5 to 1, 0.99 is usual", share.0)));
    }
    let quality = match (arguments.substeps, arguments.strain) {
        (Some(substeps), _) => Quality::Substeps(substeps),
        (None, Some(strain)) => holding(strain),
        (None, None) => named.first().copied().unwrap_or_default(),
    };
    if let Quality::Strain(strain) | Quality::Hold { stretch: strain, .. } = quality
        && strain >= 1.0
    {
        let percent = 100.0 * strain;
        warn("warning", &format!("a strain of {strain} allows the cloth to stretch by {percent:.0} %; 0.03 is three percent"));
    }
    let method = match (arguments.method.or(file.method).unwrap_or_default(), arguments.iterations, file.iterations) {
        (Method::Relaxation { .. }, Some(iterations), _) => Method::Relaxation { iterations },
        (Method::Relaxation { .. }, None, Some(iterations)) => Method::Relaxation { iterations: iterations.0 },
        (_, Some(_), _) => {
            return Err(Failure::input("--iterations belongs to --method relaxation; add that, or leave it out"));
        }
        (_, None, Some(_)) if arguments.method.is_none() => {
            return Err(wrong("iterations belong to method = \"relaxation\"; add that, or leave them out"));
        }
        (method, ..) => method,
    };
    Ok(Options {
        quality,
        method,
        levels: arguments.levels.or(file.levels).unwrap_or(Levels::Auto),
        tethers: file.tethers.unwrap_or(Tethers::Auto),
        ..Options::default()
    })
}

/// The output files.
fn outputs(arguments: &Arguments, file: &File, timeline: Timeline, read: Vec<PathBuf>) -> Result<Outputs, Failure> {
    let Timeline { frames, fps, .. } = timeline;
    let output = &file.output;
    let of = |argument: &Option<PathBuf>, file: &Option<PathBuf>| argument.clone().or(file.clone());
    let formats = if arguments.format.is_empty() { output.formats() } else { arguments.format.clone() };
    let Arguments { save, every, resume, .. } = arguments;
    if (save.is_some() || resume.is_some()) && !formats.contains(&Format::Obj) {
        return Err(Failure::input("--save and --resume need the frames as OBJ files; add obj to --format"));
    }
    let picture = |option: &str, path: Option<PathBuf>| match path {
        Some(path)
            if OTHER_PICTURES.iter().any(|other| path.extension().is_some_and(|name| name.eq_ignore_ascii_case(other))) =>
        {
            Err(Failure::input(format_args!("{option} {}: pictures are written as PNG; name a .png file", path.display())))
        }
        path => Ok(path),
    };
    Ok(Outputs {
        folder: of(&arguments.out, &output.folder).unwrap_or_else(|| "frames".into()),
        frames,
        fps,
        formats,
        pc2: of(&arguments.pc2, &output.pc2),
        preview: picture("--preview", of(&arguments.preview, &output.preview))?,
        animation: picture("--animate", of(&arguments.animate, &output.animation))?,
        report: of(&arguments.report, &output.report),
        save: save.clone(),
        every: *every,
        resume: resume.clone(),
        read,
    })
}
