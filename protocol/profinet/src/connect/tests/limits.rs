//! How many of each part a Connect and its answer can have: up to [`COUNT_LIMIT`].

use super::*;
use crate::block;

const MOST: u16 = COUNT_LIMIT as u16;

/// Parses the ARBlockReq of the capture with what is written behind it.
fn behind_ar(emit: impl FnOnce(&mut BlockWriter<'_>)) -> Result<(), Violation> {
    ConnectRequest::parse(&[&request_blocks()[..95], &emitted(emit)].concat()).map(|_| ())
}

/// Returns an IOCR with so many objects and consumer statuses.
fn iocr(objects: u16, consumer_statuses: u16) -> Iocr {
    let captured = ConnectRequest::parse(&request_blocks()).unwrap().iocrs.remove(0);
    let some = |count| (0..count).map(|offset| Object { slot: 1, subslot: 1, offset }).collect();
    Iocr { objects: some(objects), consumer_statuses: some(consumer_statuses), ..captured }
}

fn write_iocr_with_apis(w: &mut BlockWriter<'_>, apis: u16) {
    let whole = emitted(|w| iocr(0, 0).emit(w));
    // The head before the fields; number of APIs, API, and two numbers of objects behind them.
    let fields = &whole[6..whole.len() - 10];
    block::write(w, BlockType::Iocr, |w| {
        w.bytes(fields);
        w.u16(apis);
        for _ in 0..apis {
            w.u32(API);
            w.zeros(4);
        }
    });
}

fn module(slot: u16, submodules: u16) -> ExpectedModule {
    let submodule = |subslot| ExpectedSubmodule {
        subslot,
        ident: 1,
        properties: 0,
        input_len: Some(1),
        output_len: None,
    };
    ExpectedModule { slot, ident: 1, properties: 0, submodules: (0..submodules).map(submodule).collect() }
}

fn write_modules_in_one_block(w: &mut BlockWriter<'_>, modules: u16) {
    block::write(w, BlockType::ExpectedSubmodule, |w| {
        w.u16(modules);
        for slot in 0..modules {
            let one = emitted(|w| module(slot, 1).emit(w));
            // Behind the head and the number of APIs.
            w.bytes(&one[8..]);
        }
    });
}

#[test]
fn a_connect_has_up_to_512_of_each_part_and_one_more_is_refused_by_its_name() {
    type Write = fn(&mut BlockWriter<'_>, u16);
    let cases: [(Violation, Write); 7] = [
        (Violation::Head(Block::Iocr, HeadField::Type), |w, count| {
            let iocr = iocr(0, 0);
            (0..count).for_each(|_| iocr.emit(w));
        }),
        (Violation::IocrApiCount, write_iocr_with_apis),
        (Violation::IoDataCount, |w, count| iocr(count, 0).emit(w)),
        (Violation::IocsCount, |w, count| iocr(0, count).emit(w)),
        (Violation::ExpectedApiCount, |w, count| (0..count).for_each(|slot| module(slot, 1).emit(w))),
        (Violation::ExpectedApiCount, write_modules_in_one_block),
        (Violation::ExpectedSubmoduleCount, |w, count| module(1, count).emit(w)),
    ];
    for (violation, write) in cases {
        assert_eq!(behind_ar(|w| write(w, MOST)), Ok(()), "{violation:?}");
        assert_eq!(behind_ar(|w| write(w, MOST + 1)), Err(violation));
    }
}

#[test]
fn iocrs_and_modules_without_an_api_are_refused() {
    assert_eq!(behind_ar(|w| write_iocr_with_apis(w, 0)), Err(Violation::IocrApiCount));
    assert_eq!(behind_ar(|w| write_modules_in_one_block(w, 0)), Err(Violation::ExpectedApiCount));
}

#[test]
fn an_answer_has_up_to_512_iocrs_that_are_read_and_one_ar() {
    let datagram = captured::datagram(captured::CONNECT_RES);
    let (header, body) = Header::parse(&datagram).unwrap();
    let mut response = ConnectResponse::parse(ResponseArgs::parse(&header, body).unwrap().blocks).unwrap();
    let ar = emitted(|w| response.ar.emit(w));
    response.iocrs = vec![response.iocrs[0]; COUNT_LIMIT + 1];
    let blocks = emitted(|w| response.emit(w));
    assert_eq!(ConnectResponse::parse(&blocks).unwrap().iocrs.len(), COUNT_LIMIT);
    let twice = Err(Violation::Head(Block::ArRes, HeadField::Type));
    assert_eq!(ConnectResponse::parse(&[&blocks[..], &ar].concat()), twice);
}

#[test]
fn a_module_diff_has_up_to_512_modules_of_up_to_512_submodules() {
    let diff = |modules: usize, submodules: usize| {
        let submodule = DiffSubmodule { subslot: 1, ident: 1, state: SubmoduleState::WRONG };
        let module = DiffModule {
            slot: 1,
            ident: 1,
            state: ModuleState::ProperModule,
            submodules: vec![submodule; submodules],
        };
        let blocks = emitted(|w| diff::emit(&vec![module; modules], w));
        parse_module_diff(&blocks).map(|diff| diff.unwrap().len())
    };
    let wrong = Err(Violation::Head(Block::ModuleDiff, HeadField::Length));
    assert_eq!(diff(COUNT_LIMIT, 0), Ok(COUNT_LIMIT));
    assert_eq!(diff(COUNT_LIMIT + 1, 0), wrong);
    assert_eq!(diff(1, COUNT_LIMIT), Ok(1));
    assert_eq!(diff(1, COUNT_LIMIT + 1), wrong);
}
