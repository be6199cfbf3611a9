use super::*;
use crate::captured;
use crate::rpc::{Header, RequestArgs, ResponseArgs};
use crate::samples::emitted;
use crate::status::{Service, Status};

fn request_blocks() -> Vec<u8> {
    let datagram = captured::datagram(captured::CONNECT_REQ);
    let (header, body) = Header::parse(&datagram).unwrap();
    RequestArgs::parse(&header, body).unwrap().blocks.to_vec()
}

#[test]
fn the_connect_of_a_siemens_controller_is_parsed_completely() {
    let request = ConnectRequest::parse(&request_blocks()).unwrap();
    assert_eq!(request.ar.session, 2);
    assert_eq!(request.ar.initiator_name, b"plcxbbench.profinetxainterfacexb25fbd");
    assert!(request.ar.properties.has(ArProperties::ADVANCED_STARTUP));
    let [input, output] = &request.iocrs[..] else { panic!("two IOCRs") };
    assert_eq!((input.iocr_type, input.rt_class, input.frame_id), (IocrType::Input, RtClass::Class1, 0x8000));
    assert_eq!((output.iocr_type, output.data_length), (IocrType::Output, 40));
    assert_eq!(input.objects.len(), 6);
    assert_eq!(output.consumer_statuses.len(), 6);
    assert_eq!(input.cycle_time().period(), core::time::Duration::from_millis(32));
    assert_eq!(input.cycle_time().multiplied(input.data_hold_factor), core::time::Duration::from_millis(96));
    assert_eq!(request.alarm_cr.unwrap().max_data_length, 256);
    let slots: Vec<_> =
        request.expected.iter().map(|module| (module.slot, module.submodules.len())).collect();
    assert_eq!(slots, [(0, 3), (1, 1), (2, 1), (3, 1), (4, 1)]);
    assert!(request.expected[0].submodules.iter().all(ExpectedSubmodule::has_no_io));
    assert_eq!(request.expected[4].submodules[0].output_len, Some(8));
}

#[test]
fn the_same_blocks_are_written_in_our_order() {
    let blocks = request_blocks();
    let request = ConnectRequest::parse(&blocks).unwrap();
    let ours = emitted(|writer| request.emit(writer));
    assert_eq!(ConnectRequest::parse(&ours).unwrap(), request);
    // The alarm CR is last in the capture; we write it before the expected submodules.
    let alarm_cr = blocks.len() - 26;
    let expected = blocks.windows(2).position(|pair| pair == [1, 4]).unwrap();
    let reordered = [&blocks[..expected], &blocks[alarm_cr..], &blocks[expected..alarm_cr]].concat();
    assert_eq!(ours, reordered);
}

#[test]
fn the_answer_of_p_net_is_parsed_and_written_back_byte_for_byte() {
    let datagram = captured::datagram(captured::CONNECT_RES);
    let (header, body) = Header::parse(&datagram).unwrap();
    let args = ResponseArgs::parse(&header, body).unwrap();
    let response = ConnectResponse::parse(args.blocks).unwrap();
    assert_eq!(response.iocrs[1].frame_id, 0x8001);
    assert_eq!(response.server.as_deref(), Some(&b"rt-labs-dev"[..]));
    assert_eq!(emitted(|writer| response.emit(writer)), args.blocks);
}

#[test]
fn every_cut_of_the_blocks_is_refused_or_ends_between_two_blocks() {
    let blocks = request_blocks();
    let whole: Vec<usize> =
        (0..blocks.len()).filter(|len| ConnectRequest::parse(&blocks[..*len]).is_ok()).collect();
    assert_eq!(whole, [95, 203, 311, 375, 411, 447, 489, 531]);
}

#[test]
fn wrong_blocks_are_refused_and_unsupported_options_skipped() {
    let mut blocks = request_blocks();
    let ar_len = 95;
    let twice = [&blocks[..], &blocks[..ar_len]].concat();
    assert_eq!(ConnectRequest::parse(&twice), Err(Violation::Head(Block::Ar, HeadField::Type)));
    let alarm_cr = blocks[blocks.len() - 26..].to_vec();
    assert_eq!(ConnectRequest::parse(&[&blocks[..], &alarm_cr[..]].concat()), Err(Violation::AlarmCrCount));
    assert_eq!(ConnectRequest::parse(&blocks[ar_len..]), Err(Violation::Head(Block::Ar, HeadField::Type)));
    blocks.extend([0x77, 0x77, 0, 2, 1, 0]);
    assert_eq!(ConnectRequest::parse(&blocks), Err(Violation::UnknownBlocks));
    let unknown = blocks.len() - 6;
    // An ARVendorBlockReq, of whatever version.
    blocks[unknown..unknown + 2].copy_from_slice(&[1, 8]);
    for version in [[1, 0], [1, 1], [2, 0]] {
        blocks[unknown + 4..].copy_from_slice(&version);
        assert!(ConnectRequest::parse(&blocks).is_ok(), "{version:?}");
    }
    blocks[unknown..].copy_from_slice(&[1, 5, 0, 2, 1, 0]);
    let parameter_server = Violation::Head(Block::PrmServer, HeadField::Type);
    assert_eq!(ConnectRequest::parse(&blocks), Err(parameter_server));
    assert_eq!(parameter_server.status(Service::Connect), Status(0xDB81_0500));
    blocks[unknown..unknown + 2].copy_from_slice(&[1, 2]);
    blocks[unknown + 4..].copy_from_slice(&[2, 0]);
    let newer = Violation::Head(Block::Iocr, HeadField::VersionHigh);
    assert_eq!(ConnectRequest::parse(&blocks), Err(newer), "a block that is read");
}

#[test]
fn a_newer_block_in_an_answer_hides_none_of_those_that_are_known() {
    let datagram = captured::datagram(captured::CONNECT_RES);
    let (header, body) = Header::parse(&datagram).unwrap();
    let blocks = ResponseArgs::parse(&header, body).unwrap().blocks;
    let newer = [blocks, &[0x81, 0x08, 0, 4, 1, 1, 0, 0]].concat();
    assert_eq!(ConnectResponse::parse(&newer), ConnectResponse::parse(blocks));
    assert_eq!(parse_module_diff(&newer[newer.len() - 8..]), Ok(None));
}

#[test]
fn wrong_modules_are_reported_slot_by_slot() {
    let response = ConnectResponse {
        ar: ArResponse {
            ar_type: 1,
            uuid: crate::Uuid([3; 16]),
            session: 1,
            responder_mac: machine::ethernet::Mac([2; 6]),
            responder_rt_port: 0x8892,
        },
        iocrs: Vec::new(),
        alarm_cr: None,
        diff: vec![DiffModule {
            slot: 1,
            ident: 0x100,
            state: ModuleState::WrongModule,
            submodules: vec![DiffSubmodule { subslot: 1, ident: 0x101, state: SubmoduleState::WRONG }],
        }],
        server: None,
    };
    let blocks = emitted(|writer| response.emit(writer));
    assert_eq!(ConnectResponse::parse(&blocks), Ok(response));
    assert!(!SubmoduleState::WRONG.is_usable() && SubmoduleState::PROPER.is_usable());
}

#[test]
fn a_submodule_state_is_read_in_both_of_its_formats() {
    // With FormatIndicator: own, application ready pending, substitute, locked by another controller.
    for usable in [0x8000, 0x8080, 0x8800, 0x8180] {
        assert!(SubmoduleState(usable).is_usable(), "0x{usable:04X}");
    }
    // Without it, Detail: locked by another controller, application ready pending, substitute.
    for usable in [2, 4, 7] {
        assert!(SubmoduleState(usable).is_usable(), "0x{usable:04X}");
    }
    // Wrong and none, in either format.
    for unusable in [0x9000, 0x9800, 0x9080, 0, 1] {
        assert!(!SubmoduleState(unusable).is_usable(), "0x{unusable:04X}");
    }
}

#[test]
fn a_block_that_is_cut_is_named_in_the_violation() {
    for (block_type, block) in [
        (BlockType::Iocr, Block::Iocr),
        (BlockType::AlarmCr, Block::AlarmCr),
        (BlockType::ExpectedSubmodule, Block::ExpectedSubmodule),
        (BlockType::PrmServer, Block::PrmServer),
        (BlockType::Mcr, Block::Mcr),
        (BlockType::ArRpc, Block::ArRpc),
        (BlockType::ArVendor, Block::ArVendor),
        (BlockType::IrInfo, Block::IrInfo),
        (BlockType::SrInfo, Block::SrInfo),
        (BlockType::ArFsu, Block::ArFsu),
        (BlockType::RsInfo, Block::RsInfo),
        (BlockType::IocrResponse, Block::IocrRes),
        (BlockType::AlarmCrResponse, Block::AlarmCrRes),
        (BlockType::ModuleDiff, Block::ModuleDiff),
        (BlockType::ArServer, Block::ArServer),
        (BlockType::ArResponse, Block::ArRes),
        (BlockType::Unknown(0x7777), Block::Ar),
    ] {
        let [high, low] = u16::from(block_type).to_be_bytes();
        let blocks = [&request_blocks()[..95], &[high, low, 0, 9, 1, 0]].concat();
        let cut = Err(Violation::Head(block, HeadField::Length));
        assert_eq!(ConnectRequest::parse(&blocks), cut, "{block_type:?}");
    }
}

#[test]
fn a_controllers_name_has_up_to_240_bytes() {
    let mut request = ConnectRequest::parse(&request_blocks()).unwrap();
    let mut parse = |len| {
        request.ar.initiator_name = vec![b'a'; len];
        ConnectRequest::parse(&emitted(|w| request.emit(w))).map(|parsed| parsed.ar.initiator_name.len())
    };
    assert_eq!(parse(240), Ok(240));
    assert_eq!(parse(241), Err(Violation::StationNameLength));
}

#[test]
fn the_data_of_a_submodule_are_those_that_its_properties_say() {
    use Violation::{DataDescription, SubmoduleDataLength, SubmoduleProperties};
    let parse = |kind: u16, descriptions: &[(u16, u16)]| {
        let block = emitted(|w| {
            block::write(w, BlockType::ExpectedSubmodule, |w| {
                w.u16(1);
                w.u32(API);
                w.u16(1);
                w.u32(0x100);
                w.u16(0);
                w.u16(1);
                w.u16(1);
                w.u32(0x101);
                w.u16(kind);
                for (direction, len) in descriptions {
                    w.u16(*direction);
                    w.u16(*len);
                    w.bytes(&[1, 1]);
                }
            });
        });
        let request = ConnectRequest::parse(&[&request_blocks()[..95], &block].concat())?;
        let submodule = request.expected[0].submodules[0];
        Ok((submodule.input_len, submodule.output_len, submodule.has_no_io()))
    };
    assert_eq!(parse(0, &[(1, 0)]), Ok((Some(0), None, true)));
    assert_eq!(parse(1, &[(1, 1_439)]), Ok((Some(1_439), None, false)));
    assert_eq!(parse(2, &[(2, 4)]), Ok((None, Some(4), false)));
    assert_eq!(parse(3, &[(2, 4), (1, 0)]), Ok((Some(0), Some(4), false)));
    assert_eq!(parse(0, &[(1, 4)]), Err(SubmoduleProperties), "no I/O, but an input");
    assert_eq!(parse(0, &[(2, 0)]), Err(SubmoduleProperties), "no I/O, but an output");
    assert_eq!(parse(1, &[(2, 4)]), Err(SubmoduleProperties), "an input, but an output is there");
    assert_eq!(parse(2, &[(1, 4)]), Err(SubmoduleProperties), "an output, but an input is there");
    assert_eq!(parse(3, &[(1, 4), (1, 4)]), Err(DataDescription), "the same twice");
    assert_eq!(parse(1, &[(1, 1_440)]), Err(SubmoduleDataLength));
}

mod limits;
