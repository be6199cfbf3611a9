# The two nodes and the bench, each a static binary in an image of its own with nothing else in it.
# docker-compose.yml runs them; README.md says how.

FROM rust:1.95 AS build
# Cargo's profile: `release`, or `dev`, which builds in half the time.
ARG PROFILE=release
RUN command -v setcap || (apt-get update && apt-get install --yes --no-install-recommends libcap2-bin)
WORKDIR /src
COPY . .
# The flag is for the target alone: build scripts and macros are linked as usual because --target is named.
RUN target=$(rustc -vV | sed -n 's/^host: //p') \
    && RUSTFLAGS="-C target-feature=+crt-static" cargo build --locked --profile "$PROFILE" --target "$target" \
        --package plc-node --package robot-node --package bench \
    && mkdir --parents /out/runs \
    && cp target/"$target"/*/plc-node target/"$target"/*/robot-node target/"$target"/*/bench /out \
    && rm --recursive target
# Raw Ethernet frames (PROFINET's DCP and RT_CLASS_1) are the one thing that an ordinary user may not send.
RUN setcap cap_net_raw=ep /out/plc-node && setcap cap_net_raw=ep /out/robot-node

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
