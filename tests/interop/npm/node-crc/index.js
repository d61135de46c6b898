// CRC of whole bytes, most significant bit first, of up to 16 bits: what canopen needs for block transfer (CiA 301: 0x1021).
'use strict';

exports.crc = (width, reflected, polynomial, initial, ...rest) => {
    const data = rest[rest.length - 1];
    if (width !== 16 || reflected)
        throw new RangeError('only CRC-16, not reflected');
    let value = initial;
    for (const byte of data) {
        value ^= byte << 8;
        for (let i = 0; i < 8; ++i)
            value = ((value << 1) ^ (value & 0x8000 ? polynomial : 0)) & 0xffff;
    }
    const result = Buffer.alloc(2);
    result.writeUInt16BE(value);
    return result;
};
