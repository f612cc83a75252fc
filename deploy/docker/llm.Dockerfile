# The swarm's image and an embedded language model; only the gateway runs from it.
# The context is made by deploy/docker/llm_image.py: wheels/.
ARG BASE=coadapt-edge

FROM ${BASE} AS model
COPY wheels /wheels
RUN pip install --no-cache-dir --no-index --no-deps --target /opt/llm /wheels/*.whl

FROM ${BASE}
COPY --from=model /opt/llm /opt/llm
ENV PYTHONPATH=/app:/opt/llm
RUN python3 -m llm_gateway.backends.llamacpp.worker \
      --model smollm2-135m --parallel 1 --context 64 --threads 1 --try
