//! Each input of the corpora passes: what a fuzzer found interesting, and what once crashed.

use std::path::Path;

use fuzz::TARGETS;

#[test]
fn every_input_of_every_corpus_passes() {
    let corpora = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    for (name, target) in TARGETS {
        let inputs = std::fs::read_dir(corpora.join(name))
            .unwrap_or_else(|error| panic!("the corpus {name}: {error}"));
        let mut count = 0;
        for input in inputs {
            let path = input.unwrap_or_else(|error| panic!("the corpus {name}: {error}")).path();
            let data = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            println!("{}", path.display());
            target(&data);
            count += 1;
        }
        assert!(count > 0, "the corpus {name} is empty");
    }
}
