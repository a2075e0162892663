//! The progress bar: on standard error, and only where that is a terminal.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::render::Progress;

/// Shows how far a render is.
pub(super) struct Bar(ProgressBar);

impl Bar {
    /// A bar for a render that ends after `passes`, or, where that is not known, after `time`.
    pub(super) fn new(passes: Option<u64>, time: Option<Duration>, quiet: bool) -> Self {
        if quiet {
            return Self(ProgressBar::hidden());
        }
        // Passes are the unit where their number is known, milliseconds otherwise.
        let length = passes.unwrap_or_else(|| time.map_or(0, |t| t.as_millis() as u64));
        let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
        let template = "[{elapsed}] [{bar:30}] {msg}, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        Self(bar)
    }

    pub(super) fn update(&self, progress: &Progress, by_passes: bool) {
        let seconds = progress.elapsed.as_secs_f64().max(1e-9);
        let position =
            if by_passes { u64::from(progress.passes) } else { progress.elapsed.as_millis() as u64 };
        self.0.set_position(position);
        self.0.set_message(format!(
            "{} passes, {:.2} M rays/s",
            progress.passes,
            progress.rays as f64 / seconds / 1e6
        ));
    }

    pub(super) fn finish(&self) {
        self.0.finish_and_clear();
    }
}
