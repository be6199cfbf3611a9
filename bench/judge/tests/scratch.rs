//! x
#![allow(clippy::all, clippy::unwrap_used)]
use judge::hunt::*;
use judge::*;
#[test]
fn one() {
    let Ok(f) = std::env::var("CASE") else { return };
    let case = Case::parse(&std::fs::read_to_string(&f).unwrap()).unwrap();
    let s = setup::setup(if f.contains("A-") { "A" } else { "B" }).unwrap();
    let o = driver::run(&case, &s, &violation::Class::ALL).unwrap();
    println!("{:?}", o.violation.map(|v| v.to_string()));
}
#[test]
fn hunt_all() {
    let n: u64 = std::env::var("N").map_or(4000, |n| n.parse().unwrap());
    let seed: u64 = std::env::var("SEED").map_or(2026, |n| n.parse().unwrap());
    for setup in ["A", "B"] {
        if std::env::var("ONLY").is_ok_and(|o| o != setup) {
            continue;
        }
        let s = setup::setup(setup).unwrap();
        let halves: Vec<_> = [0..n / 2, n / 2..n]
            .map(|range| {
                let s = s.clone();
                std::thread::spawn(move || hunt(&s, seed, range, &violation::Class::ALL).unwrap())
            })
            .into_iter()
            .collect();
        let mut tally = Tally::default();
        for h in halves {
            tally.add(h.join().unwrap());
        }
        println!(
            "{setup}: {} cases {} cycles {} motions ended {:?}",
            tally.cases, tally.cycles, tally.motions, tally.ended
        );
        println!("{setup}: {:?}", tally.by_class());
        let mut seen = std::collections::HashMap::new();
        for (number, v) in &tally.found {
            let c = seen.entry(v.class).or_insert(0);
            *c += 1;
            if *c <= 12 {
                println!("{setup} {number}: {v}");
                if std::env::var("SHRINK").is_ok() {
                    let case = generator::case(&s, seed, *number);
                    let (small, v) = shrink::shrink(&case, v, &s, &violation::Class::ALL);
                    let f = format!("/tmp/shrunk/{setup}-{}-{number}.toml", v.class.name());
                    std::fs::create_dir_all("/tmp/shrunk").unwrap();
                    std::fs::write(&f, small.to_toml().unwrap()).unwrap();
                    println!("   {f}: {v}");
                }
            }
        }
    }
}
#[test]
fn direct() {
    let Ok(f) = std::env::var("CASE") else { return };
    let case = Case::parse(&std::fs::read_to_string(&f).unwrap()).unwrap();
    let s = setup::setup(if f.contains("A-") { "A" } else { "B" }).unwrap();
    let config = case.robot(&s).unwrap();
    let mut i = robot_node::motion::Interpolator::at_rest(
        config.arm.clone(),
        config.home,
        config.cycle.as_secs_f64(),
    );
    let motions: Vec<_> = case.runs[0].motions.iter().map(|m| m.motion()).collect();
    let mut next = 0;
    for cycle in 0..20000 {
        if next < motions.len() && next - (i.path().executed() as usize) < 5 {
            match i.path().prepare(&motions[next], &config) {
                Ok(s) => {
                    next += 1;
                    let a = i.append(s, next == motions.len());
                    println!("cycle {cycle} {a:?}");
                }
                Err(v) => {
                    println!("refused {v}");
                    break;
                }
            }
        }
        let h: Vec<usize> = std::env::var("H")
            .map_or(vec![9999999, 99999999], |h| h.split(',').map(|x| x.parse().unwrap()).collect());
        let f = if cycle >= h[0] && cycle < h[1] {
            std::env::var("F").map_or(0.0, |f| f.parse().unwrap())
        } else {
            1.0
        };
        if std::env::var("T").is_ok() {
            println!("{cycle} ex {} speed {:.3} at {:?}", i.path().executed(), i.path_speed(), i.joints());
        }
        match i.drive(f) {
            Err(v) => {
                println!(
                    "cycle {cycle} executed {} corner {} spot {}: {v}",
                    i.path().executed(),
                    i.path().corner().is_some(),
                    0
                );
                break;
            }
            Ok(step) => {
                if step.ended.is_some() {
                    println!("ended {cycle}");
                    break;
                }
            }
        }
    }
}
#[test]
fn shrink_some() {
    let Ok(list) = std::env::var("NUM") else { return };
    let jobs: Vec<_> = list
        .split(',')
        .map(|x| {
            let x = x.to_string();
            std::thread::spawn(move || {
                let (setup, number) = x.split_at(1);
                let s = setup::setup(setup).unwrap();
                let case = generator::case(
                    &s,
                    std::env::var("SEED").map_or(2026, |n| n.parse().unwrap()),
                    number.parse().unwrap(),
                );
                let v = driver::run(&case, &s, &violation::Class::ALL).unwrap().violation;
                let Some(v) = v else {
                    println!("{x} fine");
                    return;
                };
                let (small, v) = shrink::shrink(&case, &v, &s, &violation::Class::ALL);
                let f = format!("/tmp/shrunk/{setup}-{}-{number}.toml", v.class.name());
                std::fs::create_dir_all("/tmp/shrunk").unwrap();
                std::fs::write(&f, small.to_toml().unwrap()).unwrap();
                println!("{f}: {v}");
            })
        })
        .collect();
    for j in jobs {
        j.join().unwrap();
    }
}
#[test]
fn number() {
    let Ok(x) = std::env::var("NR") else { return };
    let (setup, number) = x.split_at(1);
    let s = setup::setup(setup).unwrap();
    let case = generator::case(
        &s,
        std::env::var("SEED").map_or(2026, |n| n.parse().unwrap()),
        number.parse().unwrap(),
    );
    println!(
        "{:?}",
        driver::run(&case, &s, &violation::Class::ALL).unwrap().violation.map(|v| v.to_string())
    );
}
#[test]
fn print_case() {
    let Ok(x) = std::env::var("NR") else { return };
    let (setup, number) = x.split_at(1);
    let s = setup::setup(setup).unwrap();
    let case = generator::case(
        &s,
        std::env::var("SEED").map_or(2026, |n| n.parse().unwrap()),
        number.parse().unwrap(),
    );
    println!("{}", case.to_toml().unwrap());
}
