//! Writing frames: one OBJ file each, and point caches of all frames.

use std::fs;
use std::path::{Path, PathBuf};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{CacheForm, Mesh, ObjTemplate, PointCache, PointCacheError, UpAxis};

use crate::{
    Failure,
    arguments::Format,
    output::{self, Outputs, frame_name, frame_number},
};

/// The files that frames are written to.
pub(crate) struct Frames<'a> {
    outputs: &'a Outputs,
    /// The OBJ file that the mesh was read from, if any.
    template: Option<&'a ObjTemplate>,
    /// The caches, each with the option that asked for it.
    caches: Vec<(&'static str, PointCache)>,
    /// The paths of what an earlier run may have written besides its frames, until the first frame is written.
    replaced: Option<Vec<PathBuf>>,
}

/// The file name in `--out` of a cache of a format.
pub(crate) fn cache_name(format: Format) -> Option<&'static str> {
    match format {
        Format::Obj => None,
        Format::Pc2 => Some("cloth.pc2"),
        Format::Mdd => Some("cloth.mdd"),
        Format::Usda => Some("cloth.usda"),
    }
}

impl<'a> Frames<'a> {
    /// Begins all caches. Fails if one or the first frame cannot be written, or if the folder has frames of a longer run, which would look
    /// like a part of this one.
    pub(crate) fn begin(
        outputs: &'a Outputs,
        mesh: &Mesh,
        template: Option<&'a ObjTemplate>,
        up: UpAxis,
    ) -> Result<Frames<'a>, Failure> {
        let out = &outputs.folder;
        fs::create_dir_all(out).map_err(|error| {
            Failure::input(format_args!("--out {}: {error}; name a directory that can be made", out.display()))
        })?;
        output::remove_unfinished(out);
        if outputs.writes(Format::Obj)
            && let Some(frame) = frames_in(out).max().filter(|&frame| frame > outputs.frames)
        {
            let (path, frames) = (out.join(frame_name(frame)), outputs.frames);
            let message = format_args!(
                "{} is from a longer run, and would look like a part of this one of {frames} frames; remove the old frames, or use another --out",
                path.display()
            );
            return Err(Failure::input(message));
        }
        if outputs.writes(Format::Obj) {
            output::check_folder(out)?;
        }
        let named = outputs.formats.iter().filter_map(|&format| Some(("--format", format, out.join(cache_name(format)?))));
        let mut named: Vec<(&str, Format, PathBuf)> = named.collect();
        named.extend(outputs.pc2.iter().map(|path| ("--pc2", Format::Pc2, path.clone())));
        let fps = outputs.fps;
        let Outputs { report, preview, animation, .. } = outputs;
        let besides = [report, preview, animation].into_iter().flatten();
        let replaced = Some(named.iter().map(|(_, _, path)| path).chain(besides).cloned().collect());
        let mut caches = Vec::new();
        for (option, format, path) in named {
            let form = match format {
                Format::Mdd => CacheForm::Mdd { fps },
                Format::Usda => {
                    let triangles = || mesh.triangles.iter().map(|triangle| triangle.to_vec()).collect();
                    let faces = template.map_or_else(triangles, |template| template.polygons().to_vec());
                    let texture = template.map_or_else(Vec::new, |template| template.texture_coordinates().to_vec());
                    CacheForm::Usda { fps, up, faces, texture }
                }
                Format::Obj | Format::Pc2 => CacheForm::Pc2,
            };
            output::check(&path).map_err(|failure| failure.of(option))?;
            let cache = PointCache::create_as(form, &path, mesh.positions.len(), outputs.frames as usize);
            caches.push((option, cache.map_err(|error| failed(option, &error))?));
        }
        Ok(Frames { outputs, template, caches, replaced })
    }

    /// Whether there is any cache, which must contain all frames.
    pub(crate) fn has_caches(&self) -> bool {
        !self.caches.is_empty()
    }

    /// Writes a frame to all files.
    pub(crate) fn write(&mut self, frame: u32, shape: &Mesh) -> Result<(), Failure> {
        if let Some(besides) = self.replaced.take() {
            self.remove_from(frame, besides)?;
        }
        if self.outputs.writes(Format::Obj) {
            let path = self.outputs.folder.join(frame_name(frame));
            let written = match self.template {
                Some(template) => template.save(&shape.positions, path),
                None => shape.save_obj(path),
            };
            written.map_err(Failure::input)?;
        }
        self.cache(&shape.positions)
    }

    /// Removes the caches, the report and the pictures of an earlier run, and its frames from this one on: if this run fails later, it
    /// must not seem to go on with them, or to be what they tell of. Links, pipes and devices stay, because they are written to.
    fn remove_from(&self, first: u32, besides: Vec<PathBuf>) -> Result<(), Failure> {
        let Outputs { folder, .. } = self.outputs;
        let frames = frames_in(folder).filter(|&frame| self.outputs.writes(Format::Obj) && frame >= first);
        let old: Vec<PathBuf> = frames.map(|frame| folder.join(frame_name(frame))).chain(besides).collect();
        for path in old.iter().filter(|path| fs::symlink_metadata(path).is_ok_and(|found| found.is_file())) {
            fs::remove_file(path).map_err(|error| {
                Failure::input(format_args!("cannot replace {}: {error}; remove it, or use another --out", path.display()))
            })?;
        }
        Ok(())
    }

    /// Adds a frame to the caches only.
    pub(crate) fn cache(&mut self, positions: &[Vec3]) -> Result<(), Failure> {
        self.caches.iter_mut().try_for_each(|(option, cache)| cache.push(positions).map_err(|error| failed(option, &error)))
    }

    /// Completes the caches and moves them to their paths.
    pub(crate) fn finish(self) -> Result<(), Failure> {
        self.caches.into_iter().try_for_each(|(option, cache)| cache.finish().map_err(|error| failed(option, &error)))
    }
}

/// The numbers of the frames in a folder.
fn frames_in(folder: &Path) -> impl Iterator<Item = u32> {
    let names = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    names.filter_map(|name| frame_number(name.to_str()?))
}

fn failed(option: &str, error: &PointCacheError) -> Failure {
    Failure::input(format_args!("{option}: {error}"))
}
