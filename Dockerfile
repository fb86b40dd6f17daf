# ropefit and its command line: docker build -t ropefit . && docker run --rm -v "$PWD:/data" ropefit run
# Two stages: what builds the wheel does not stay.
FROM python:3.12-slim AS build
WORKDIR /src
COPY pyproject.toml README.md ./
COPY ropefit ropefit
COPY sample_data sample_data
RUN pip wheel --no-cache-dir --no-deps -w /wheels .

FROM python:3.12-slim
COPY --from=build /wheels /wheels
COPY constraints.txt /
# --build-arg TORCH_INDEX=URL: an index with torch for processors only makes a much smaller image.
ARG TORCH_INDEX=""
RUN pip install --no-cache-dir ${TORCH_INDEX:+--extra-index-url "$TORCH_INDEX"} \
        -c /constraints.txt /wheels/*.whl \
    && python -m ropefit.system --install \
    && rm -rf /wheels /var/lib/apt/lists/*
# Anyone may run it; what numba compiles is kept in the image.
ENV NUMBA_CACHE_DIR=/var/cache/ropefit
RUN mkdir -p $NUMBA_CACHE_DIR && ropefit warm-up \
    && chmod -R a+rwX $NUMBA_CACHE_DIR
WORKDIR /data
ENTRYPOINT ["ropefit"]
