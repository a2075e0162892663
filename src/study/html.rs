//! Reports as one HTML file that opens without network: style and images are within it.

use std::fmt::{Display, Write as _};
use std::io;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use crate::film::{Image, output::encode_png};

/// What every report looks like.
const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}\
table{border-collapse:collapse;margin:1em 0}td,th{border-bottom:1px solid #ccc;padding:.25em .9em;text-align:right}\
td:first-child,th:first-child{text-align:left}figure{display:inline-block;margin:.5em 1em .5em 0}\
img{max-width:100%;image-rendering:pixelated}pre{overflow-x:auto;background:#f4f4f4;padding:.8em}svg{max-width:100%;height:auto}";

/// A page in the making. Text is escaped wherever it is put in.
#[derive(Debug, Clone)]
pub struct Page(String);

impl Page {
    /// A page with a title, which is its first heading too.
    pub fn new(title: &str) -> Self {
        let title = escape(title);
        Self(format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\n<style>{STYLE}</style></head>\n<body><h1>{title}</h1>\n"
        ))
    }

    /// A heading of the second order.
    pub fn heading(&mut self, text: &str) {
        self.push(format_args!("<h2>{}</h2>\n", escape(text)));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.push(format_args!("<p>{}</p>\n", escape(text)));
    }

    /// Paragraphs with a dot before each.
    pub fn list<S: AsRef<str>>(&mut self, items: &[S]) {
        self.0.push_str("<ul>\n");
        for item in items {
            self.push(format_args!("<li>{}</li>\n", escape(item.as_ref())));
        }
        self.0.push_str("</ul>\n");
    }

    /// A drawing, which is markup already and is not escaped.
    pub fn svg(&mut self, svg: &str) {
        self.push(format_args!("<p>{svg}</p>\n"));
    }

    /// Text in lines of its own.
    pub fn preformatted(&mut self, text: &str) {
        self.push(format_args!("<pre>{}</pre>\n", escape(text)));
    }

    /// A table; the first of its rows is the header.
    pub fn table<S: AsRef<str>>(&mut self, rows: &[Vec<S>]) {
        self.0.push_str("<table>\n");
        for (i, row) in rows.iter().enumerate() {
            let tag = if i == 0 { "th" } else { "td" };
            self.0.push_str("<tr>");
            for cell in row {
                self.push(format_args!("<{tag}>{}</{tag}>", escape(cell.as_ref())));
            }
            self.0.push_str("</tr>\n");
        }
        self.0.push_str("</table>\n");
    }

    /// An image with a caption.
    ///
    /// # Errors
    /// If PNG has no such image.
    pub fn image(&mut self, caption: &str, image: &Image) -> io::Result<()> {
        let data = STANDARD.encode(encode_png(image)?);
        let caption = escape(caption);
        self.push(format_args!(
            "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>\n"
        ));
        Ok(())
    }

    /// Images beside each other, as far as there is room, each with a caption.
    ///
    /// # Errors
    /// If PNG has no such image.
    pub fn images(&mut self, images: &[(&str, &Image)]) -> io::Result<()> {
        self.0.push_str("<div>\n");
        for (caption, image) in images {
            self.image(caption, image)?;
        }
        self.0.push_str("</div>\n");
        Ok(())
    }

    /// The finished page.
    pub fn finish(mut self) -> String {
        self.0.push_str("</body></html>\n");
        self.0
    }

    fn push(&mut self, text: impl Display) {
        // Writing to a String cannot fail.
        let _ = write!(self.0, "{text}");
    }
}

/// Text as it may stand in HTML, in attributes too.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use glam::{UVec2, Vec3};

    use super::Page;
    use crate::film::Image;

    #[test]
    fn text_is_escaped_and_images_are_within() {
        let mut page = Page::new("a <b> & \"c\"");
        page.heading("<script>");
        page.paragraph("1 < 2");
        page.preformatted("<&>");
        page.table(&[vec!["x", "<i>"], vec!["1", "2"]]);
        page.list(&["<u>", "b"]);
        page.svg("<svg></svg>");
        let image = Image::of_colours(UVec2::ONE, &[Vec3::ONE]);
        page.images(&[("\"><x", &image)]).expect("a PNG");
        let text = page.finish();
        assert!(text.contains("<title>a &lt;b&gt; &amp; &quot;c&quot;</title>"), "{text}");
        for tag in ["<b>", "<script>", "<i>", "<u>", "<x"] {
            assert!(!text.contains(tag), "{tag} in {text}");
        }
        assert!(text.contains("<th>&lt;i&gt;</th>") && text.contains("<td>2</td>"), "{text}");
        assert!(text.contains("<li>b</li>") && text.contains("<svg></svg>"), "{text}");
        // The first eight bytes of every PNG.
        assert!(text.contains("src=\"data:image/png;base64,iVBORw0KGgo"), "{text}");
    }
}
