/*
 * Any bytes into the C decoders: no undefined behaviour, and an accepted frame encodes to the bytes it came from.
 *
 * The input goes in twice: as a stream, and as content with a right checksum, which a fuzzer does not find by itself.
 */
#include "../c/bench_proto.c" /* for its checksum and stuffing, which are private */

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t size);

static void check(bp_sender sender, const uint8_t *stream, size_t size)
{
    bp_decoder decoder;
    bp_frame frame;
    uint8_t wire[BP_MAX_WIRE];
    bp_decoder_init(&decoder, sender);
    for (size_t i = 0; i < size; i++) {
        if (bp_decoder_push(&decoder, stream[i], &frame) == BP_FRAME) {
            const size_t length = bp_encode(&frame, wire);
            if (length > i + 1 || memcmp(stream + i + 1 - length, wire, length) != 0) {
                abort();
            }
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t size)
{
    uint8_t content[MAX_CONTENT];
    uint8_t wire[BP_MAX_WIRE];
    uint8_t *at = content;
    const size_t used = size < MAX_CONTENT - CRC_LEN ? size : MAX_CONTENT - CRC_LEN;
    for (size_t i = 0; i < used; i++) {
        put(&at, input[i], 1);
    }
    put(&at, crc32(content, used), CRC_LEN);
    const size_t length = stuff(content, used + CRC_LEN, wire);
    check(BP_FROM_HOST, input, size);
    check(BP_FROM_BOARD, input, size);
    check(BP_FROM_HOST, wire, length);
    check(BP_FROM_BOARD, wire, length);
    return 0;
}
