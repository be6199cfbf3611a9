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
fn an_arm_that_meets_others_stores_one_program_with_its_marks_and_a_new_one_before_each_visit_of_a_zone() {
    for (name, programs) in [("E", 1), ("F", 1), ("G", 3)] {
        let (cell, found) = planning::cell_with_applications(name).unwrap();
        for station in found.plan(&cell).unwrap().stations {
            let (plan, sections) = (&station.plan, station.plan.sections());
            assert_eq!(sections.len(), programs, "setup {name}, {}", station.name);
            assert_eq!(Program::stored(plan, &station.setup).len(), programs);
            let bounds: Vec<_> = sections.iter().map(|section| section.motions.clone()).collect();
            assert!(bounds.windows(2).all(|pair| pair[0].end == pair[1].start));
            assert_eq!(bounds.last().unwrap().end, plan.motions.len());
            let meetings: Vec<_> = sections
                .iter()
                .flat_map(|section| {
                    let first = section.motions.start;
                    section
                        .meetings
                        .iter()
                        .map(move |meeting| (first + meeting.after as usize, meeting.signal))
                })
                .collect();
            let waits: Vec<_> = plan.waits.iter().map(|wait| (wait.after, wait.signal.unwrap())).collect();
            assert_eq!(meetings, waits, "setup {name}, {}", station.name);
            // Each action of the plan is once in a program, or the PLC's at the end of one.
            let acts = |stops: &[planning::Stop]| stops.iter().filter(|stop| stop.then.is_some()).count();
            let of_plc = plan.stops().into_iter().filter(|stop| {
                let ends = bounds.iter().any(|motions| motions.end == stop.after as usize);
                ends && programs > 1 && stop.then.is_some()
            });
            let of_programs: usize = sections.iter().map(|section| acts(&section.stops)).sum();
            assert_eq!(of_programs + of_plc.count(), acts(&plan.stops()), "setup {name}, {}", station.name);
        }
    }
}
