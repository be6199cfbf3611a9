//! `plc-node plan`: what becomes of an application, for the process engineer who writes it.

use node::Outcome;
use node::errln;
use node::output::to_stdout;
use node::screen;
use planning::{Plan, Reached};

/// An application and a setup to plan it for.
#[derive(clap::Args, Debug)]
pub(crate) struct PlanCommand {
    /// A built-in application's name, or the path of a .toml file. Without it the setup's own is planned.
    #[arg(value_name = "NAME|FILE")]
    application: Option<String>,
    /// The setup to plan for: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
    /// Print every cycle of a grid and every warning.
    #[arg(long)]
    all: bool,
}

/// Blanks before the rest of a line about marks and zones that is wider than the terminal.
const HANGING: usize = 8;

/// Warnings that are printed of a plan unless all are asked for: the cycles of a grid repeat theirs.
const WARNINGS: usize = 10;

impl PlanCommand {
    /// Prints the plan to standard output and its warnings to standard error; then whether the arm reaches it.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let (cell, _) = setup::cell(&self.setup)?;
        let Some(application) = self.application.as_deref().filter(|_| cell.is_one()) else {
            return self.execute_for_all_stations();
        };
        let setup = setup::setup(&self.setup)?;
        let application = planning::application(application, None)?;
        let plan = application.plan(&setup)?;
        let reached = application.reach(&plan, &setup);
        self.print(&plan, reached.as_ref().ok())?;
        print_start(&reached?)?;
        Ok(Outcome::Done)
    }

    /// Prints the plan of the named application for all arms, or of the setup's own: of each station, with the marks at which they wait for each other.
    fn execute_for_all_stations(self) -> anyhow::Result<Outcome> {
        let (cell, found) = planning::cell_and_application(&self.setup, self.application.as_deref())?;
        let planned = found.plan(&cell)?;
        for station in &planned.stations {
            if !cell.is_one() {
                to_stdout(format_args!("station {}\n", station.name))?;
            }
            self.print(&station.plan, Some(&station.reached))?;
            print_start(&station.reached)?;
            if !cell.is_one() {
                to_stdout(format_args!("\n"))?;
            }
        }
        if !planned.marks.is_empty() {
            for line in planned.to_string().lines() {
                let line = screen::wrapped_within(line, 0, HANGING, screen::table_width());
                to_stdout(format_args!("{line}\n"))?;
            }
        }
        Ok(Outcome::Done)
    }

    /// Prints a plan to standard output and its warnings to standard error.
    fn print(&self, plan: &Plan, reached: Option<&Reached>) -> anyhow::Result<()> {
        // A width that a format can carry has 16 bits.
        let width = screen::table_width().min(usize::from(u16::MAX));
        let text = if self.all { format!("{plan:#width$}") } else { format!("{plan:width$}") };
        to_stdout(format_args!("{text}"))?;
        let shown = if self.all { usize::MAX } else { WARNINGS };
        let mut warnings = plan.warnings();
        warnings.extend(reached.map(Reached::warnings).unwrap_or_default());
        warnings.iter().take(shown).for_each(|warning| errln!("warning: {warning}"));
        let unseen = warnings.len().saturating_sub(shown);
        if unseen > 0 {
            errln!("{unseen} more warnings; --all prints them");
        }
        Ok(())
    }
}

/// Prints where an arm that reaches its plan stands at the start.
fn print_start(reached: &Reached) -> anyhow::Result<()> {
    let joints = reached.start.iter().take(reached.axes).map(|joint| format!("{:.3}", joint + 0.0));
    let joints = joints.collect::<Vec<_>>().join(", ");
    to_stdout(format_args!("the arm reaches all of it; at its start home_deg would be\n[{joints}]\n"))?;
    Ok(())
}
