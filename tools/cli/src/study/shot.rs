//! A reference picture and what is compared with it.

use csbrdf::assess::render::picture::psnr_over;
use csbrdf::assess::render::rays::{Material, Scene, render, subject_mask};
use csbrdf::assess::render::scene::Ball;
use csbrdf::assess::render::{Image, Texels};

use super::plan::Plan;
use crate::picture::Picture;

/// How the page explains the two figures of [`Psnr`].
pub const DEFINITION: &str = "PSNR: peak 1, mean squared error of the three channels of clamped sRGB values (gamma \
    as in 8-bit pictures, not rounded), both pictures exposed so that the 99th percentile of the reference's \
    brightest channel over the objects is 0.9 in linear light. Given over the pixels of the objects, background \
    excluded; in brackets and in CSV also over the whole picture, background included.";

/// PSNR in dB.
#[derive(Clone, Copy, Debug)]
pub struct Psnr {
    /// Over the pixels of the objects.
    pub objects: f64,
    /// Over all pixels.
    pub picture: f64,
}

/// A picture that others are compared with.
pub struct Shot {
    pub image: Image,
    mask: Vec<bool>,
    exposure: f32,
}

impl Shot {
    /// The reference `image` of a scene.
    pub fn new(scene: &impl Scene, image: Image) -> Shot {
        let mask = subject_mask(scene, image.width, image.height);
        let exposure = image.exposure_over(&mask);
        Shot { image, mask, exposure }
    }

    /// A sphere of the reference material.
    pub fn sphere(plan: &Plan, texels: &Texels) -> Shot {
        Shot::new(&Ball, sphere(plan, texels))
    }

    pub fn psnr(&self, other: &Image) -> csbrdf::Result<Psnr> {
        let all = vec![true; self.mask.len()];
        Ok(Psnr {
            objects: psnr_over(&self.image, other, self.exposure, &self.mask)?,
            picture: psnr_over(&self.image, other, self.exposure, &all)?,
        })
    }

    /// The reference.
    pub fn picture(&self) -> Picture {
        Picture::of(&self.image, self.exposure)
    }

    /// Another picture with this exposure.
    pub fn expose(&self, other: &Image) -> Picture {
        Picture::of(other, self.exposure)
    }

    /// The difference times 8.
    pub fn difference(&self, other: &Image) -> csbrdf::Result<Picture> {
        Picture::difference(&self.image, other, self.exposure)
    }

    /// Another picture with the difference times 8 in its lower right corner, a third of its size.
    pub fn with_inset(&self, other: &Image) -> csbrdf::Result<Picture> {
        let mut picture = self.expose(other);
        let (w, h) = (other.width, other.height);
        picture.place(w - w / 3, h - h / 3, &self.difference(other)?.shrunk(3));
        Ok(picture)
    }
}

/// The sphere of a material.
pub fn sphere(plan: &Plan, texels: &Texels) -> Image {
    let material: Material = &|wi, wo| texels.eval(wi, wo);
    render(&Ball, &[material], &plan.environment, &plan.sphere_quality())
}
