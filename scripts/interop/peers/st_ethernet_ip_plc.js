// st-ethernet-ip as class 1 scanner: sends its outputs whenever inputs come, enables and resets the robot, has it run its
// program 1 and checks what it says meanwhile. Bytes as in skill_image.py, little-endian.
//
// usage: node st_ethernet_ip_plc.js ADDRESS RPI-IN-MS
const { IO } = require("st-ethernet-ip");

const [address, rpi] = process.argv.slice(2);
const [ENABLE, EXECUTE, RESET, BUSY, DONE, ERROR, ENABLED] = [1, 2, 32, 1, 2, 8, 32];
const [READY, RUN_PROGRAM, NUMBER] = [1, 17, 0x0b0b];

const scanner = new IO.Scanner();
const connection = scanner.addConnection(
    {
        configInstance: { assembly: 151, size: 0 },
        outputInstance: { assembly: 150, size: 256 },
        inputInstance: { assembly: 100, size: 256 },
    },
    Number(rpi),
    address,
);
const fail = (words) => {
    console.log(`failed: ${words}`);
    process.exit(1);
};
setTimeout(() => fail(`the robot did not finish: ${echoes.size} echoes, ready ${number !== 0}`), 20_000);

let [life, number, busy] = [0, 0, false];
const [lives, echoes] = [new Set(), new Set()];
setInterval(() => {
    const output = Buffer.alloc(256);
    life = (life + 1) & 0xffff;
    output.writeUInt16LE(number ? ENABLE | EXECUTE : ENABLE | RESET, 0);
    output.writeUInt16LE(life, 2);
    output.writeUInt16LE(number, 4);
    output.writeUInt8(RUN_PROGRAM, 6);
    output.writeUInt8(100, 7);
    output.writeUInt16LE(1, 16);
    connection.outputData = output;

    const input = connection.inputData;
    if (input.length !== 256) fail(`${input.length} bytes of feedback`);
    const status = input.readUInt16LE(0);
    if (status & ERROR) fail(`the robot reports error ${input.readUInt16LE(6)}`);
    echoes.add(input.readUInt16LE(22));
    lives.add(input.readUInt16LE(24));
    if (number === 0 && input.readUInt8(2) === READY && status & ENABLED) {
        console.log("robot ready");
        number = NUMBER;
    }
    const ours = number !== 0 && input.readUInt16LE(4) === number;
    busy ||= Boolean(ours && status & BUSY);
    if (busy && ours && status & DONE) {
        if (lives.size < 20 || echoes.size < 20) fail(`${lives.size} lives, ${echoes.size} echoes`);
        console.log(`${input.readUInt32LE(8)} motions, ${lives.size} lives, ${echoes.size} echoes`);
        // It leaves without a Forward_Close.
        process.exit(0);
    }
}, Number(rpi));
