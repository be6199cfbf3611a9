//! The programs that a robot of a setup stores for RC.

use planning::PROGRAM;
use robot_node::Program;

#[test]
fn a_robot_that_works_alone_stores_the_plan_as_one_program() {
    for name in ["A", "B", "C", "D"] {
        let (setup, application) = planning::setup_with_application(name).unwrap();
        let plan = application.plan(&setup).unwrap();
        let whole = Program::new(plan.wire_motions(&setup), &plan.stops());
        assert_eq!(Program::stored(&plan, &setup), [(PROGRAM, whole)], "setup {name}");
    }
}

#[test]
fn an_arm_that_waits_for_others_stores_a_program_for_each_section_between_marks_and_before_each_visit_of_a_zone()
 {
    for name in ["E", "F", "G"] {
        let (cell, found) = planning::cell_with_applications(name).unwrap();
        for station in found.plan(&cell).unwrap().stations {
            let (plan, setup) = (&station.plan, &station.setup);
            let (motions, stops) = (plan.wire_motions(setup), plan.stops());
            let waits = plan.waits.iter().map(|wait| wait.after);
            let visits = plan.visits.iter().map(|visit| visit.after);
            let mut bounds: Vec<_> = [0, motions.len()].into_iter().chain(waits).chain(visits).collect();
            bounds.sort_unstable();
            bounds.dedup();
            assert!(bounds.len() > 2, "setup {name}: {} waits within its motions", station.name);
            let expected: Vec<_> = (PROGRAM..)
                .zip(bounds.windows(2))
                .map(|(number, bounds)| {
                    // The action at a section's end is the PLC's.
                    let within = stops.iter().copied().filter(|stop| {
                        let after = stop.after as usize;
                        bounds[0] < after && after < bounds[1]
                    });
                    let shifted =
                        within.map(|stop| planning::Stop { after: stop.after - bounds[0] as u32, ..stop });
                    (
                        number,
                        Program::new(motions[bounds[0]..bounds[1]].to_vec(), &shifted.collect::<Vec<_>>()),
                    )
                })
                .collect();
            assert_eq!(Program::stored(plan, setup), expected, "setup {name}, {}", station.name);
        }
    }
}
