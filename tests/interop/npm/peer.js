// A CANopen device of the npm package `canopen` on a clock and a bus that Python owns.
//
// Each line on stdin is a step, {"t": ns, "frames": [[id, hex], ...], "calls": [[number, name, arguments], ...]}; each is
// answered by one line, {"frames": [...], "events": [[kind, detail], ...], "wake": ns or null}. Between two lines
// nothing happens: timers run when a step says it is their time.
'use strict';

const realSetImmediate = setImmediate;
const { EventEmitter } = require('events');

// The clock -------------------------------------------------------------------------------------------------------
let nowMs = 0;
let nTimers = 0;
let nImmediates = 0;
const timers = new Map();

class Timer {
    constructor(call, delay, args, repeat) {
        this.number = ++nTimers;
        this.call = () => call(...args);
        this.delay = Math.max(Number(delay) || 0, 0.001);
        this.repeat = repeat;
        this.refresh();
    }
    refresh() {
        this.due = nowMs + this.delay;
        timers.set(this.number, this);
        return this;
    }
    ref() { return this; }
    unref() { return this; }
}

const clear = (timer) => { if (timer) timers.delete(timer.number); };
globalThis.setTimeout = (call, delay, ...args) => new Timer(call, delay, args, false);
globalThis.setInterval = (call, delay, ...args) => new Timer(call, delay, args, true);
globalThis.clearTimeout = globalThis.clearInterval = clear;
globalThis.setImmediate = (call, ...args) => {
    ++nImmediates;
    return realSetImmediate(() => {
        --nImmediates;
        call(...args);
    });
};
Date.now = () => nowMs;

const next = () => {
    let first = null;
    for (const timer of timers.values()) {
        if (first === null || timer.due < first.due || (timer.due === first.due && timer.number < first.number))
            first = timer;
    }
    return first;
};

// Lets promises and immediates run until nothing is left to do.
const settle = async () => {
    do
        await new Promise((resolve) => realSetImmediate(resolve));
    while (nImmediates > 0);
    await new Promise((resolve) => realSetImmediate(resolve));
};

// The device ------------------------------------------------------------------------------------------------------
const { Device, Eds } = require('canopen');

let device = null;
let frames = [];
let events = [];
const tell = (kind, detail) => events.push([kind, detail]);
const hex = (data) => Buffer.from(data).toString('hex');

const open = (id, eds) => {
    device = new Device({ id, eds: eds === null ? new Eds() : Eds.fromFile(eds) });
    device.on('message', ({ id: cobId, data }) => frames.push([cobId, hex(data)]));
    device.nmt.on('heartbeat', ({ deviceId, state }) => tell('heartbeat', { node: deviceId, state }));
    device.nmt.on('timeout', (node) => tell('timeout', { node }));
    device.nmt.on('changeState', (state) => tell('state', { state }));
    device.emcy.on('emergency', ({ cobId, em }) =>
        tell('emcy', { cobId, code: em.code, register: em.register, info: hex(em.info), text: em.toString() }));
    device.sync.on('sync', (counter) => tell('sync', { counter: typeof counter === 'object' && counter !== null ? hex(counter) : counter ?? '' }));
    device.pdo.on('pdo', (pdo) => tell('pdo', { cobId: pdo.cobId, values: pdo.dataObjects.map((o) => o.value) }));
};

const CALLS = {
    open: ({ id, eds }) => open(id, eds),
    start: () => device.start(),
    // Client side
    addServer: ({ node }) => device.eds.addSdoClientParameter(node, 0x600 + node, 0x580 + node),
    upload: async ({ node, index, sub, block, timeout }) =>
        hex(await device.sdo.upload({ deviceId: node, index, subIndex: sub, blockTransfer: block, timeout })),
    download: ({ node, index, sub, data, block, timeout }) => device.sdo.download({
        deviceId: node, index, subIndex: sub, data: Buffer.from(data, 'hex'), blockTransfer: block, timeout }),
    watchHeartbeat: ({ node, ms }) => device.eds.addHeartbeatConsumer(node, ms),
    watchEmcy: ({ cobId }) => device.eds.addEmcyConsumer(cobId),
    nmt: ({ command, node }) => device.nmt[command](node),
    sync: ({ counter }) => {
        device.sync.cobId = 0x80;
        device.sync.generate = true;
        device.sync.write(counter);
    },
    consumeSync: () => { device.sync.cobId = 0x80; },
    receivePdo: ({ cobId, index, names, dataType }) => device.eds.addReceivePdo({
        cobId,
        dataObjects: names.map((parameterName, i) => device.eds.addEntry(
            index + i, { parameterName, dataType: [dataType].flat()[i] || dataType, accessType: 'rw' })),
    }),
    // Server side
    raw: ({ index, sub }) => hex(sub === null ? device.getRaw(index) : device.getRawArray(index, sub)),
    setRaw: ({ index, sub, data }) => (sub === null
        ? device.setRaw(index, Buffer.from(data, 'hex')) : device.setRawArray(index, sub, Buffer.from(data, 'hex'))),
    emcy: ({ code, info }) => device.emcy.write({ code, info: Buffer.from(info, 'hex') }),
    // What its own reader makes of an EDS
    readEds: ({ eds }) => {
        const read = Eds.fromFile(eds);
        const pdos = (list) => list.map(({ cobId, transmissionType, dataObjects, dataSize }) =>
            ({ cobId, transmissionType, n: dataObjects.length, size: dataSize }));
        return {
            objects: Object.keys(read.dataObjects).map(Number), receive: pdos(read.getReceivePdos()), transmit: pdos(read.getTransmitPdos()),
        };
    },
    // LSS master
    startLss: () => device.lss.start(),
    fastscan: ({ timeout }) => device.lss.fastscan({ timeout }),
    lssMode: ({ mode }) => device.lss.switchModeGlobal(mode),
    lssNode: ({ node }) => device.lss.configureNodeId(node),
    lssStore: () => device.lss.storeConfiguration(),
};

const call = async (number, name, args) => {
    try {
        const value = await CALLS[name](args);
        tell('done', { number, value: value === undefined ? null : value });
    }
    catch (error) {
        tell('failed', { number, code: error.code === undefined ? null : error.code, text: String(error) });
    }
};

const step = async ({ t, frames: received, calls }) => {
    const untilMs = t / 1e6;
    for (let timer = next(); timer !== null && timer.due <= untilMs; timer = next()) {
        nowMs = Math.max(nowMs, timer.due);
        if (timer.repeat)
            timer.refresh();
        else
            clear(timer);
        timer.call();
        await settle();
    }
    nowMs = untilMs;
    for (const [id, data] of received) {
        if (device !== null)
            device.receive({ id, data: Buffer.from(data, 'hex') });
        await settle();
    }
    for (const [number, name, args] of calls) {
        call(number, name, args);
        await settle();
    }
    const timer = next();
    const answer = { frames, events, wake: timer === null ? null : Math.ceil(timer.due * 1e6) };
    frames = [];
    events = [];
    return answer;
};

// The bridge ------------------------------------------------------------------------------------------------------
EventEmitter.defaultMaxListeners = 0;
let text = '';
let busy = Promise.resolve();
process.stdin.setEncoding('utf8');
process.stdin.on('data', (chunk) => {
    const lines = (text + chunk).split('\n');
    text = lines.pop();
    for (const line of lines)
        busy = busy.then(() => step(JSON.parse(line))).then((answer) => process.stdout.write(JSON.stringify(answer) + '\n'));
});
process.stdin.on('end', () => process.exit(0));
