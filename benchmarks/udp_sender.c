/* Sends the MAVLink 2 frames of a file to 127.0.0.1, one in each datagram, again and again, at an even rate (0: as fast
 * as it goes). Each is given the next sequence number, its stamp since boot, and the checksum that follows from them.
 * Use: udp_sender PORT RATE COUNT FIRST FILE; FIRST: number of the first frame. FILE holds each frame behind a head of
 * eight bytes: length, CRC_EXTRA, place of the stamp in the payload (255: none), its size, its unit in us (uint16,
 * little-endian), and two of zero.
 * Prints the frames sent and the seconds it took. What the socket refuses is tried again: nothing is left out. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

#define BURST 64
#define HEAD 8

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static uint16_t crc_step(uint16_t crc, uint8_t byte)
{
    uint8_t t = byte ^ (uint8_t)crc;
    t ^= t << 4;
    return (crc >> 8) ^ ((uint16_t)t << 8) ^ ((uint16_t)t << 3) ^ (t >> 4);
}

/* Number, stamp and checksum of the frame behind `head`. */
static void renew(uint8_t *head, long number, double rate)
{
    uint8_t *frame = head + HEAD;
    int payload = frame[1], at = head[2], size = head[3], unit = head[4] | head[5] << 8;
    frame[4] = (uint8_t)number;
    if (at + size <= payload) {
        uint64_t stamp = (uint64_t)(number / (rate > 0 ? rate : 1e6) * 1e6 / unit) + 1;
        for (int k = 0; k < size; k++)
            frame[10 + at + k] = (uint8_t)(stamp >> (8 * k));
    }
    uint16_t crc = 0xFFFF;
    for (int k = 1; k < 10 + payload; k++)
        crc = crc_step(crc, frame[k]);
    crc = crc_step(crc, head[1]);
    frame[10 + payload] = (uint8_t)crc;
    frame[11 + payload] = crc >> 8;
}

int main(int argc, char **argv)
{
    if (argc != 6) {
        fprintf(stderr, "use: udp_sender PORT RATE COUNT FIRST FILE\n");
        return 2;
    }
    double rate = atof(argv[2]);
    long count = atol(argv[3]), first = atol(argv[4]);
    FILE *file = fopen(argv[5], "rb");
    if (!file) {
        perror(argv[5]);
        return 1;
    }
    fseek(file, 0, SEEK_END);
    long size = ftell(file);
    rewind(file);
    uint8_t *data = malloc(size);
    struct iovec *parts = malloc(sizeof *parts * (size / HEAD + 1));
    if (!data || !parts || fread(data, 1, size, file) != (size_t)size) {
        fprintf(stderr, "%s cannot be read\n", argv[5]);
        return 1;
    }
    long frames = 0;
    for (long at = 0; at + HEAD < size; at += HEAD + data[at]) {
        parts[frames].iov_base = data + at + HEAD;
        parts[frames++].iov_len = data[at];
    }
    if (frames < BURST) {
        fprintf(stderr, "%s holds %ld frames, fewer than one burst\n", argv[5], frames);
        return 1;
    }
    int fd = socket(AF_INET, SOCK_DGRAM, 0);
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(atoi(argv[1]))};
    inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
    if (fd < 0 || connect(fd, (struct sockaddr *)&to, sizeof to) < 0) {
        perror("socket");
        return 1;
    }
    struct mmsghdr messages[BURST];
    memset(messages, 0, sizeof messages);
    long sent = 0;
    double start = now();
    while (sent < count) {
        long due = rate > 0 ? (long)((now() - start) * rate) + 1 - sent : BURST;
        if (due > count - sent)
            due = count - sent;
        if (due <= 0) {
            double wait = (sent + 1) / rate - (now() - start);
            if (wait < 50e-6)
                wait = 50e-6;
            struct timespec pause = {(time_t)wait, (long)((wait - (time_t)wait) * 1e9)};
            nanosleep(&pause, NULL);
            continue;
        }
        int burst = due > BURST ? BURST : (int)due;
        for (int k = 0; k < burst; k++) {
            struct iovec *part = &parts[(sent + k) % frames];
            renew((uint8_t *)part->iov_base - HEAD, first + sent + k, rate);
            messages[k].msg_hdr.msg_iov = part;
            messages[k].msg_hdr.msg_iovlen = 1;
        }
        int done = sendmmsg(fd, messages, burst, 0);
        if (done < 0 && errno != ENOBUFS && errno != EAGAIN && errno != ECONNREFUSED && errno != EINTR) {
            perror("send");
            return 1;
        }
        if (done > 0)
            sent += done;
    }
    printf("%ld %.6f\n", sent, now() - start);
    return 0;
}
