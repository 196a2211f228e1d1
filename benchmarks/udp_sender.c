/* Sends the datagrams of a file to 127.0.0.1, again and again, at an even rate.
 * Use: udp_sender PORT RATE COUNT FILE; FILE holds each datagram behind its length (uint32, little-endian).
 * Prints the datagrams sent and the seconds it took. What the socket refuses is tried again: nothing is left out. */
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

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(int argc, char **argv)
{
    if (argc != 5) {
        fprintf(stderr, "use: udp_sender PORT RATE COUNT FILE\n");
        return 2;
    }
    double rate = atof(argv[2]);
    long count = atol(argv[3]);
    FILE *file = fopen(argv[4], "rb");
    if (!file) {
        perror(argv[4]);
        return 1;
    }
    fseek(file, 0, SEEK_END);
    long size = ftell(file);
    rewind(file);
    char *data = malloc(size);
    struct iovec *parts = malloc(sizeof *parts * (size / 4 + 1));
    if (!data || !parts || fread(data, 1, size, file) != (size_t)size) {
        fprintf(stderr, "%s cannot be read\n", argv[4]);
        return 1;
    }
    long frames = 0;
    for (long at = 0; at + 4 <= size;) {
        uint32_t length;
        memcpy(&length, data + at, 4);
        parts[frames].iov_base = data + at + 4;
        parts[frames++].iov_len = length;
        at += 4 + (long)length;
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
            messages[k].msg_hdr.msg_iov = &parts[(sent + k) % frames];
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
