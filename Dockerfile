# The two nodes and the bench, each a static binary in an image of its own with nothing else in it.
# docker-compose.yml runs them; docs/permissions.md says how. It takes BuildKit, as the builder before it loses the capabilities
# that a file has.

FROM rust:1.95 AS build
# Cargo's profile: `release`, or `dev`, which builds in half the time.
ARG PROFILE=release
RUN command -v setcap || (apt-get update && apt-get install --yes --no-install-recommends libcap2-bin)
# The commit of the sources, which come without their repository: `git rev-parse --short=12 HEAD`.
ARG SKILLBENCH_COMMIT=
WORKDIR /src
COPY . .
# The flag is for the target alone: build scripts and macros are linked as usual because --target is named. What was
# compiled is kept for the next build.
RUN --mount=type=cache,target=/src/target \
    target=$(rustc -vV | sed -n 's/^host: //p') \
    && RUSTFLAGS="-C target-feature=+crt-static" cargo build --locked --profile "$PROFILE" --target "$target" \
        --target-dir "target/$PROFILE" --package plc-node --package robot-node --package bench \
    && mkdir --parents /out/runs \
    && for program in plc-node robot-node bench; do \
        strip --strip-debug -o /out/$program target/"$PROFILE"/"$target"/*/$program || exit 1; \
    done
# What an ordinary user may not do and a container may permit: raw Ethernet frames, SCHED_FIFO, locked memory.
RUN for node in plc-node robot-node; do setcap cap_net_raw,cap_sys_nice,cap_ipc_lock=p /out/$node; done

FROM scratch AS plc-node
COPY --from=build /out/plc-node /plc-node
USER 65534:65534
ENTRYPOINT ["/plc-node"]

FROM scratch AS robot-node
COPY --from=build /out/robot-node /robot-node
USER 65534:65534
ENTRYPOINT ["/robot-node"]

FROM scratch AS bench
COPY --from=build /out/bench /bench
# A named volume takes its owner from here.
COPY --from=build --chown=65534:65534 /out/runs /runs
USER 65534:65534
ENTRYPOINT ["/bench"]
