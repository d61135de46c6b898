/* A board on Linux: SocketCAN, readings of a noisy converter without tactels, parameters in a file. */
#include <errno.h>
#include <fcntl.h>
#include <net/if.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <linux/can.h>
#include <linux/can/raw.h>

#include "skin.h"

#define FLASH_BYTES 16384u

static struct sb_board board;
static int can, file = -1;

bool can_send(struct sb_board *b, const struct sb_frame *frame, bool urgent)
{
    struct canfd_frame out = {.can_id = frame->id, .len = frame->length};
    const bool is_fd = frame->flags & SB_FD;
    /* the kernel has one queue, for urgent frames too */
    out.flags = is_fd ? CANFD_BRS : 0;
    memcpy(out.data, frame->data, frame->length);
    return write(can, &out, is_fd ? CANFD_MTU : CAN_MTU) > 0;
}

bool can_receive(struct sb_board *b, struct sb_frame *frame)
{
    struct canfd_frame in;
    const ssize_t n = recv(can, &in, sizeof in, MSG_DONTWAIT);
    if (n <= 0) {
        if (n < 0 && errno != EAGAIN && errno != EINTR && errno != ENETDOWN)
            exit(1);
        return false;
    }
    memset(frame, 0, sizeof *frame);
    /* of extended frames and error frames an identifier that no board hears */
    frame->id = (uint16_t)(in.can_id & (CAN_EFF_FLAG | CAN_ERR_FLAG) ? 0x7FF : in.can_id & CAN_SFF_MASK);
    frame->flags = (uint8_t)((in.can_id & CAN_RTR_FLAG ? SB_REMOTE : 0) | ((size_t)n == CANFD_MTU ? SB_FD : 0));
    frame->length = in.len;
    memcpy(frame->data, in.data, in.len < SB_FRAME_BYTES ? in.len : SB_FRAME_BYTES);
    frame->t_us = micros(b);
    return true;
}

uint32_t micros(struct sb_board *b)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)(1000000 * (uint64_t)now.tv_sec + (uint64_t)now.tv_nsec / 1000);
}

uint8_t sample(struct sb_board *b, int16_t readings[SB_N_TACTELS], uint16_t *age_100us)
{
    const int step = SB_READING_BYTES == 1 ? 1 : 16;
    *age_100us = 0;
    for (unsigned k = 0; k < SB_N_TACTELS; k++)
        readings[k] = (int16_t)(step * (rand() % 3 - 1));
    return 0;
}

bool flash_read(struct sb_board *b, unsigned page, size_t at, uint8_t *data, size_t n)
{
    const ssize_t got = pread(file, data, n, (off_t)(page * b->flash_bytes + at));
    if (got < 0)
        return false;
    memset(&data[got], 0xFF, n - (size_t)got);
    return true;
}

bool flash_write(struct sb_board *b, unsigned page, size_t at, const uint8_t data[8])
{
    if (at == 0)
        fsync(file); /* the page before is whole before this one goes */
    return pwrite(file, data, 8, (off_t)(page * b->flash_bytes + at)) == 8 && fdatasync(file) == 0;
}

void restart(struct sb_board *b) {} /* of another program, which it has no slots for */

void relay_output(struct sb_board *b, bool closed)
{
    static int shown = -1;
    if (shown != closed)
        puts(closed ? "closed" : "open");
    shown = closed;
    fflush(stdout);
}

int main(int n, char **words)
{
    if (n < 3) {
        fprintf(stderr, "usage: %s INTERFACE NODE-ID [SERIAL [PARAMETER-FILE]]\n", words[0]);
        return 2;
    }
    struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(words[1])};
    const int on = 1;
    can = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    if (can < 0 || !address.can_ifindex || bind(can, (struct sockaddr *)&address, sizeof address) != 0) {
        perror(words[1]);
        return 1;
    }
    setsockopt(can, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on);
    if (n > 4)
        file = open(words[4], O_RDWR | O_CREAT, 0644);
    const uint32_t serial = n > 3 ? (uint32_t)strtoul(words[3], NULL, 0) : 0;
    sb_init(&board, (uint8_t)strtoul(words[2], NULL, 0), serial, file < 0 ? 0 : FLASH_BYTES);
    for (;;) {
        struct pollfd waits = {.fd = can, .events = POLLIN};
        const uint32_t us = sb_turn(&board);
        const struct timespec time = {.tv_sec = us / 1000000, .tv_nsec = 1000 * (long)(us % 1000000)};
        ppoll(&waits, 1, &time, NULL);
    }
}
