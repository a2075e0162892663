//! The `texture` plugins, and parameters that may be textured.

use glam::{Affine2, DAffine3, DVec2};

use super::super::image::Content;
use super::super::{LoadError, Location};
use super::plugin::{Kind, Parameter, Plugin};
use super::properties::Properties;
use super::xml::{Category, Document, ObjectId, Span};
use super::{Attribute, Builder};
use crate::scene::{Bitmap, Input, Rgb, TexelFilter, Texture, TextureId, Textures, Wrap};

pub(super) type Build = fn(&Properties, &mut Builder) -> Result<Texture, LoadError>;

pub(super) const PLUGINS: &[Plugin<Build>] = &[
    Plugin::new(
        "bitmap",
        "image file: PNG, JPEG, OpenEXR, Radiance HDR, TGA or BMP",
        &[
            &[
                Parameter::required("filename", Kind::String, "beside the scene, or in a <path>"),
                Parameter::new(
                    "filter_type",
                    Kind::String,
                    "bilinear",
                    "between texels: bilinear or nearest",
                ),
                Parameter::new(
                    "wrap_mode",
                    Kind::String,
                    "repeat",
                    "beyond the image: repeat, mirror or clamp",
                ),
                Parameter::new("raw", Kind::Boolean, "false", "numbers as they are, not sRGB colours"),
                Parameter::new(
                    "format",
                    Kind::String,
                    "variant",
                    "no effect: images keep the depth of their file",
                ),
            ],
            TO_UV,
        ],
        bitmap,
    ),
    Plugin::new(
        "checkerboard",
        "squares of half a unit",
        &[
            &[
                Parameter::new("color0", Kind::Reflectance, "0.4", "of the square at the origin"),
                Parameter::new("color1", Kind::Reflectance, "0.2", "of the squares beside it"),
            ],
            TO_UV,
        ],
        |p, b| {
            Ok(Texture::Checkerboard {
                color0: b.color_input(p, "color0")?,
                color1: b.color_input(p, "color1")?,
                to_uv: to_uv(p)?,
            })
        },
    ),
    Plugin::new(
        "scale",
        "a texture times a factor (Mitsuba 0.6)",
        &[&[
            Parameter::new("scale", Kind::Unbounded, "1", "the factor"),
            Parameter::object(Category::Texture, "the texture"),
        ]],
        |p, b| {
            let factor = p.color("scale")?;
            let Some((object, at)) = p.objects(Category::Texture).next() else {
                return Err(p.error("", "`scale` without a texture", "one"));
            };
            p.optional_object(Category::Texture)?;
            let texture = b.texture(object, at)?;
            Ok(Texture::Scale { texture, factor })
        },
    ),
    Plugin::new(
        "mesh_attribute",
        "numbers on vertices or faces of a mesh, of 1 or 3 channels; not in principled BSDFs or those made of others",
        &[&[
            Parameter::required("name", Kind::String, "as in the file, after `vertex_` or `face_`"),
            Parameter::new("scale", Kind::Float, "1", "factor"),
        ]],
        |p, _| {
            let name = p.string("name")?.to_owned();
            if !(name.starts_with("vertex_") || name.starts_with("face_")) {
                return Err(p.bad_value("name", "a name that begins with `vertex_` or `face_`"));
            }
            let scale = p.float("scale")? as f32;
            if !scale.is_finite() {
                return Err(p.bad_value("scale", "a number within single precision"));
            }
            Ok(Texture::MeshAttribute { name, scale })
        },
    ),
];

const TO_UV: &[Parameter] =
    &[Parameter::optional("to_uv", Kind::Transform, "texture coordinates of the surface to those used here")];

fn bitmap(p: &Properties, builder: &mut Builder) -> Result<Texture, LoadError> {
    p.choice(
        "format",
        &[("variant", ()), ("auto", ()), ("fp16", ()), ("fp32", ()), ("float16", ()), ("float32", ())],
    )?;
    let filter =
        p.choice("filter_type", &[("bilinear", TexelFilter::Bilinear), ("nearest", TexelFilter::Nearest)])?;
    let wraps = [("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)];
    let wrap = p.choice("wrap_mode", &wraps)?;
    let path = p.document.resolve_path(p.string("filename")?, p.object.at);
    let image = builder.images.get(&path, Some(&p.locate("filename")), Content::Color, builder.log)?;
    Ok(Texture::Bitmap(Bitmap { image, raw: p.boolean("raw")?, filter, wrap, to_uv: to_uv(p)? }))
}

/// The part of a transform that acts on x and y.
fn to_uv(p: &Properties) -> Result<Affine2, LoadError> {
    let t: DAffine3 = p.transform("to_uv");
    let flat = |v: glam::DVec3| DVec2::new(v.x, v.y).as_vec2();
    let m = Affine2 {
        matrix2: glam::Mat2::from_cols(flat(t.matrix3.x_axis), flat(t.matrix3.y_axis)),
        translation: flat(t.translation),
    };
    if m.is_finite() { Ok(m) } else { Err(p.error("to_uv", "`to_uv` overflows", "a smaller transform")) }
}

/// The image files that a scene names, to be read in parallel.
pub(super) fn files(document: &Document) -> Vec<(std::path::PathBuf, Location)> {
    let bitmaps = document
        .objects()
        .filter(|o| matches!((o.category, o.plugin.as_str()), (Category::Texture, "bitmap")));
    bitmaps
        .filter_map(|object| {
            let filename = object.properties.iter().find(|p| p.name == "filename")?;
            let path = document.resolve_path(&filename.text, object.at);
            Some((path, document.locate(filename.at)))
        })
        .collect()
}

impl Builder<'_> {
    /// A colour, given as a value or as a texture.
    pub(super) fn color_input(&mut self, p: &Properties, name: &str) -> Result<Input<Rgb>, LoadError> {
        let Some((object, at)) = p.texture(name)? else { return Ok(Input::Constant(p.color(name)?)) };
        let id = self.texture(object, at)?;
        if let (Kind::Reflectance, Texture::Bitmap(bitmap)) = (p.kind(name), &self.textures[id.0 as usize]) {
            let greatest = bitmap.image.max_value();
            if greatest > 1.0 {
                let message = format!("`{name}` has values up to {greatest}; what is above 1 counts as 1");
                self.log.warn(p.document.locate(at), message);
            }
        }
        Ok(Input::Texture(id))
    }

    /// A number, given as a value or as a texture.
    pub(super) fn float_input(&mut self, p: &Properties, name: &str) -> Result<Input<f32>, LoadError> {
        match p.texture(name)? {
            Some((object, at)) => Ok(Input::Texture(self.texture(object, at)?)),
            None => Ok(Input::Constant(p.float(name)? as f32)),
        }
    }

    /// A fraction in 0..1, given as a number, a colour (of which the mean counts) or a texture.
    pub(super) fn fraction_input(&mut self, p: &Properties, name: &str) -> Result<Input<f32>, LoadError> {
        Ok(match self.color_input(p, name)? {
            Input::Constant(color) => Input::Constant((color.element_sum() / 3.0).clamp(0.0, 1.0)),
            Input::Texture(id) => Input::Texture(id),
        })
    }

    /// The texture of an object; each is built once, however many refer to it.
    pub(super) fn texture(&mut self, id: ObjectId, at: Span) -> Result<TextureId, LoadError> {
        match self.texture_ids.get(&id) {
            Some(&Some(texture)) => {
                self.attributes.extend(self.attributes_of(texture, at));
                return Ok(texture);
            }
            Some(None) => return self.error(at, "a texture that contains itself", "no circular references"),
            None => {}
        }
        if self.depth >= super::MAX_BSDF_DEPTH {
            return self.error(
                at,
                "textures in each other",
                format!("at most {} levels", super::MAX_BSDF_DEPTH),
            );
        }
        self.texture_ids.insert(id, None);
        self.depth += 1;
        let grey = Input::Constant(Rgb::splat(0.5));
        let mut texture = Texture::Checkerboard { color0: grey, color1: grey, to_uv: Affine2::IDENTITY };
        if let Some((build, properties)) = self.properties(PLUGINS, id, "grey of 0.5 is used")? {
            texture = build(&properties, self)?;
            properties.finish()?;
        }
        self.depth -= 1;
        self.textures.push(texture);
        let new = TextureId(self.textures.len() as u32 - 1);
        self.texture_ids.insert(id, Some(new));
        self.attributes.extend(self.attributes_of(new, at));
        Ok(new)
    }

    /// What a texture asks of meshes.
    pub(super) fn attributes_of(&self, id: TextureId, at: Span) -> Vec<Attribute> {
        let mut found = Vec::new();
        Textures::new(&self.textures).each_attribute(id, &mut |name| found.push((name.to_owned(), at)));
        found
    }
}
