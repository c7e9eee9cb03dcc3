/** What the page takes of three.js to draw an arm; `npm run three` writes it to server/static/three/three.js. */

export {
  CircleGeometry, CylinderGeometry, DirectionalLight, Group, HemisphereLight, Mesh, MeshStandardMaterial,
  PerspectiveCamera, Scene, SphereGeometry, TorusGeometry, Vector3, WebGLRenderer,
} from "three";
