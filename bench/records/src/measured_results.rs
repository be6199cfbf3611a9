//! Results of samples that no bench measured.

use plc_node::ExecutionType;
use setup::Setup;

use crate::origin::{MeasuredType, OriginKind, SampleOrigin};
use crate::results::{FailedRepetition, PerType, Results, Status, TypeResult};

impl Results {
    /// Creates the results of samples that were measured elsewhere. They have no simulated figures.
    #[must_use]
    pub fn measured(
        setup: &Setup,
        application: &str,
        origin: SampleOrigin,
        types: &PerType<MeasuredType>,
    ) -> Self {
        let mut results = Self::empty([&setup.name, application, origin.kind.mode()]);
        results.title.clone_from(&setup.title);
        results.origin = Some(origin);
        results.status = Status::Complete;
        for execution_type in ExecutionType::ALL {
            let Some(measured) = types.get(execution_type) else { continue };
            let count = u32::try_from(measured.repetitions.len()).unwrap_or(u32::MAX);
            results.reps = results.reps.max(count);
            *results.results.entry(execution_type) = Some(TypeResult::measured(measured));
        }
        results.derive_figures();
        results
    }

    /// Returns how the run was measured, for a line that describes it.
    #[must_use]
    pub fn mode_in_words(&self) -> String {
        match self.origin.as_ref().map(|origin| origin.kind) {
            None => format!("{} mode", self.mode),
            Some(OriginKind::Capture) => "measured from a capture".to_owned(),
            Some(OriginKind::Import) => "imported".to_owned(),
        }
    }
}

impl TypeResult {
    fn measured(measured: &MeasuredType) -> Self {
        let mut result = Self::default();
        for (number, repetition) in (1..).zip(&measured.repetitions) {
            match repetition {
                Ok(time) => {
                    result.samples_ms.push(time.execution_ms);
                    result.robot_samples_ms.extend(time.robot_execution_ms);
                    result.blends_suppressed.extend(time.blends_suppressed);
                }
                Err(error) => {
                    result.failed.push(FailedRepetition { repetition: number, error: error.clone() });
                }
            }
        }
        result
    }
}
