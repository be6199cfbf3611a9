//! `plc-node plan`: what becomes of an application, for the process engineer who writes it.

use node::Outcome;
use node::errln;
use node::output::to_stdout;
use node::screen;

/// An application and a setup to plan it for.
#[derive(clap::Args, Debug)]
pub(crate) struct PlanCommand {
    /// A built-in application's name, or the path of a .toml file.
    #[arg(value_name = "NAME|FILE")]
    application: String,
    /// The setup to plan for: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
    /// Print every cycle of a grid and every warning.
    #[arg(long)]
    all: bool,
}

/// Warnings that are printed of a plan unless all are asked for: the cycles of a grid repeat theirs.
const WARNINGS: usize = 10;

impl PlanCommand {
    /// Prints the plan to standard output and its warnings to standard error; then whether the arm reaches it.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let setup = setup::setup(&self.setup)?;
        let application = planning::application(&self.application, None)?;
        let plan = application.plan(&setup)?;
        let reached = application.reach(&plan, &setup);
        // A width that a format can carry has 16 bits.
        let width = screen::table_width().min(usize::from(u16::MAX));
        let text = if self.all { format!("{plan:#width$}") } else { format!("{plan:width$}") };
        to_stdout(format_args!("{text}"))?;
        let shown = if self.all { usize::MAX } else { WARNINGS };
        let stopped = reached.as_ref().map_or(&[][..], |reached| &reached.stopped);
        let warnings = || plan.warnings().chain(stopped.iter().map(ToString::to_string));
        warnings().take(shown).for_each(|warning| errln!("warning: {warning}"));
        let unseen = warnings().skip(shown).count();
        if unseen > 0 {
            errln!("{unseen} more warnings; --all prints them");
        }
        let reached = reached?;
        let joints = reached.start.iter().take(reached.axes).map(|joint| format!("{:.3}", joint + 0.0));
        let joints = joints.collect::<Vec<_>>().join(", ");
        to_stdout(format_args!("the arm reaches all of it; at its start home_deg would be\n[{joints}]\n"))?;
        Ok(Outcome::Done)
    }
}
