//! `softtwin draw`: bodies as pixels; charts of models and recordings as vectors or pixels.

mod args;
mod charts;
mod modes;
mod placed;
mod recording;
mod states;

pub use args::Args;
pub use charts::observables;

use crate::cmd::export::is_recording;
use crate::failure::usage;
use crate::picture::canvas::Canvas;
use crate::picture::{Figure, Panel, Series};
use crate::{files, output};
use anyhow::Result;
use args::Chart;
use formats::database::ObstacleKind;

/// Charts are made of lines and can be written as .svg too; a body is made of pixels.
enum Picture {
    Chart(Figure),
    Body(Canvas),
}

impl Args {
    /// Draws the picture and prints its name.
    ///
    /// # Errors
    /// Arguments that do not fit together, files that cannot be read or written.
    pub fn run(self) -> Result<()> {
        match self.picture()? {
            Picture::Chart(figure) => {
                figure.save(&self.out)?;
                output!("{}", self.out.display())?;
            }
            Picture::Body(canvas) => {
                canvas.write_png(&self.out)?;
                output!("{} ({} x {} px)", self.out.display(), canvas.width, canvas.height)?;
            }
        }
        Ok(())
    }

    fn picture(&self) -> Result<Picture> {
        let kind = self.source.extension().and_then(|ending| ending.to_str());
        if let Some(log) = &self.log {
            let run = files::bench_run(&self.source, log)?;
            let over_time = |series: &formats::log::LogColumn| {
                let points = run.time_s.iter().copied().zip(series.values.iter().copied());
                Panel::new("", "time [s]", series.name.as_str(), vec![Series::line("", 0, points)])
            };
            let panels: Vec<Panel> = run.inputs.iter().chain(&run.outputs).map(over_time).collect();
            let title = self.source.display().to_string();
            // Few stand below each other, so that one instant is at one place in all of them.
            let columns = if panels.len() <= 3 { 1 } else { 3 };
            return Ok(Picture::Chart(Figure { title, panels, columns }));
        }
        if self.case.is_none() && is_recording(&self.source) {
            let model = self.model.as_ref().map(|path| files::model(path)).transpose()?;
            return Ok(Picture::Chart(recording::figure(&self.source, model.as_ref())?));
        }
        if let (Some(chart), Some("twin")) = (self.chart, kind) {
            return Ok(Picture::Chart(self.chart(chart)?));
        }
        if self.chart.is_none()
            && !self.out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
        {
            return Err(usage(format!(
                "--out {}: expected a name that ends in .png, because a body is drawn of pixels",
                self.out.display()
            )));
        }
        Ok(Picture::Body(match (kind, &self.case) {
            (Some("twin"), None) => self.body()?,
            (Some("toml"), None) if self.chart.is_none() => placed::scene(self, &self.source)?,
            (_, Some(case)) if self.source.is_dir() => states::case(self, case)?,
            _ => {
                return Err(usage(format!(
                    "expected a model (.twin), a scene (.toml), a database folder with --case, a recording, or a table with --log; found {}",
                    self.source.display()
                )));
            }
        }))
    }

    fn chart(&self, chart: Chart) -> Result<Figure> {
        let model = files::model(&self.source)?;
        match chart {
            Chart::ForceMap => {
                let database = self.database.as_ref().map(|dir| files::database(dir, ObstacleKind::Plate));
                charts::force_map(&model, database.transpose()?.as_ref())
            }
            Chart::SingularValues => Ok(charts::singular_values(&model)),
            Chart::Observables => observables(&model),
            Chart::Coefficients => charts::coefficients(&model),
        }
    }

    fn body(&self) -> Result<Canvas> {
        let mut model = files::model(&self.source)?;
        files::set_parameters(&mut model, &self.settings)?;
        match &self.modes {
            Some(regime) => modes::draw(self, &model, regime),
            None if self.fig9 => states::fig9(self, &model),
            None => states::one(self, &model),
        }
    }
}
